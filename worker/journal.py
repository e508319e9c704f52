"""What an attempt writes down: progress, events, artifacts and its log, all under its lease."""

from __future__ import annotations

import dataclasses
import logging
import math
import mimetypes
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service.db import Database
from service.jobs.model import Artifact
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.jobs.state import EventType
from service.storage import Storage
from service.storage.base import file_sha256
from visco_core.progress import Progress

_TYPES = {".glb": "model/gltf-binary", ".ply": "application/octet-stream", ".txt": "text/plain"}
# Progress is stored at most this often; long solves report less often, so that the number of
# stored events stays in the hundreds.
_LEAST_INTERVAL, _MOST_INTERVAL, _EVENTS_A_RUN = 0.25, 5.0, 400


class Journal:
    """The writing side of one attempt. Every method raises LeaseLost once the job is gone."""

    def __init__(
        self,
        database: Database,
        storage: Storage,
        bell: Bell,
        job_id: str,
        attempt: int,
        write_seconds: float = 0.0,
    ) -> None:
        """``write_seconds``: how long writing the results will take, as far as is known."""
        self.database = database
        self.storage = storage
        self.bell = bell
        self.job_id = job_id
        self.attempt = attempt
        self.write_seconds = write_seconds
        self.phases: dict[str, float] = {}
        self.lines: list[str] = []
        self._begun = time.monotonic()
        self._phase = "fetch"
        self._phase_begun = self._begun
        self._last: Progress | None = None
        self._stored_at = -math.inf

    def enter(self, phase: str) -> None:
        """Charge the time from here on to ``phase``."""
        now = time.monotonic()
        spent = now - self._phase_begun
        self.phases[self._phase] = self.phases.get(self._phase, 0.0) + spent
        if phase != self._phase:
            self.log(f"{self._phase} took {spent:.2f} s")
        self._phase, self._phase_begun = phase, now

    def progress(self, progress: Progress) -> None:
        if progress.phase != self._phase:
            self.enter(progress.phase)
        if self._worth_storing(progress):
            self._last, self._stored_at = progress, time.monotonic()
            record = {**self._plain(progress), "attempt": self.attempt}
            with self.database.transaction() as unit:
                repository = JobRepository(unit.session)
                repository.progress(self.job_id, self.attempt, record)
                unit.after_commit(self._ring)

    def writing(self) -> None:
        """The solver is done, and its results are being written."""
        last = self._last
        fraction = 0.0 if last is None else last.fraction
        elapsed = time.monotonic() - self._begun
        self.progress(Progress("write", fraction, elapsed, remaining_seconds=0.0))

    def note(self, type: EventType, data: Mapping[str, Any]) -> None:
        """Store an event of another kind."""
        with self.database.transaction() as unit:
            JobRepository(unit.session).note(self.job_id, self.attempt, type, data)
            unit.after_commit(self._ring)

    def store(self, path: Path, name: str, event: EventType = "artifact", **told: Any) -> None:
        """Move a file into the storage as the artifact ``name``, and tell of it by an event.

        The key is this attempt's own.
        """
        key = f"artifacts/{self.job_id}/{self.attempt}/{name}"
        artifact = Artifact(
            job_id=self.job_id,
            attempt=self.attempt,
            name=name,
            key=key,
            size=path.stat().st_size,
            sha256=file_sha256(path),
            content_type=_content_type(name),
        )
        self.storage.put(key, path)
        try:
            with self.database.transaction() as unit:
                repository = JobRepository(unit.session)
                replaced = repository.store_artifact(self.job_id, self.attempt, artifact)
                repository.note(self.job_id, self.attempt, event, {"artifact": name, **told})
                unit.after_commit(self._ring)
        except Exception:
            # Bytes that no row names would be found by nobody.
            self.storage.delete(key)
            raise
        if replaced is not None:
            self.storage.delete(replaced)

    def log(self, line: str) -> None:
        moment = datetime.now(UTC).isoformat(timespec="milliseconds")
        self.lines.append(f"{moment} {line}")

    def succeed(self, result: Mapping[str, Any]) -> None:
        self.enter("done")
        phases = [{"name": name, "seconds": round(s, 4)} for name, s in self.phases.items()]
        with self.database.transaction() as unit:
            repository = JobRepository(unit.session)
            repository.succeed(self.job_id, self.attempt, {**result, "phases": phases})
            unit.after_commit(self._ring)

    def fail(self, code: str, detail: str) -> None:
        with self.database.transaction() as unit:
            JobRepository(unit.session).fail(self.job_id, self.attempt, code, detail)
            unit.after_commit(self._ring)

    def stop(self) -> None:
        with self.database.transaction() as unit:
            JobRepository(unit.session).stop(self.job_id, self.attempt)
            unit.after_commit(self._ring)

    def _plain(self, progress: Progress) -> dict[str, Any]:
        """JSON has neither NaN nor infinity; a loss that is one of them is left out."""
        record = dataclasses.asdict(progress)
        remaining = progress.remaining_seconds
        if remaining is not None:
            left = remaining + self.write_seconds
            record["remaining_seconds"] = left if math.isfinite(left) else None
        record["losses"] = {k: float(v) for k, v in progress.losses.items() if math.isfinite(v)}
        return record

    def _worth_storing(self, progress: Progress) -> bool:
        last = self._last
        if last is None or (last.phase, last.level) != (progress.phase, progress.level):
            return True
        now = time.monotonic()
        interval = (now - self._begun) / _EVENTS_A_RUN
        interval = min(max(interval, _LEAST_INTERVAL), _MOST_INTERVAL)
        return now - self._stored_at >= interval

    def _ring(self) -> None:
        self.bell.ring(self.job_id)


class LogCapture(logging.Handler):
    """Copies what the core and the worker log during an attempt into its journal."""

    def __init__(self, journal: Journal) -> None:
        super().__init__(logging.INFO)
        self.journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        self.journal.log(f"{record.levelname.lower()} {record.getMessage()}")

    def __enter__(self) -> None:
        for name in ("visco_core", "worker"):
            logging.getLogger(name).addHandler(self)

    def __exit__(self, *exception: object) -> None:
        for name in ("visco_core", "worker"):
            logging.getLogger(name).removeHandler(self)


def _content_type(name: str) -> str:
    kind = _TYPES.get(Path(name).suffix) or mimetypes.guess_type(name)[0]
    return kind or "application/octet-stream"
