"""A folder that turns scans into meshes: the end of a scanning pipeline."""

from __future__ import annotations

import fcntl
import hashlib
import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from service.client.errors import ApiError, ClientError
from service.client.flow import new_key
from service.client.ledger import Entry, Ledger
from service.client.records import Job
from service.client.sync import Client

log = logging.getLogger(__name__)
SCANS = frozenset({".ply", ".xyz", ".pts", ".obj", ".stl", ".pcd", ".las", ".laz", ".e57", ".npz"})
_RESULTS = ("mesh.glb", "mesh.ply", "preview.png", "report.json")
_LEDGER = ".visco-watch.db"
_LOCK = ".visco-watch.lock"
# The service forgets keys after 24 hours; a submission left unclear for longer is looked up.
_KEY_SECONDS = 23 * 3600
_LATER = frozenset({401, 403, 429, 500, 502, 503, 504, 507})


class CannotWatch(ClientError):
    """Another process watches the folder, or no scan could be submitted with these parameters."""


class FolderWatch:
    """Use as a context manager, and call ``look`` again and again; both raise CannotWatch.

    A file that does not change for ``settle`` seconds is submitted once; its results, or
    ``NAME.error.txt``, appear beside it. Trouble with the service or one file is logged and never
    ends the watch.
    """

    ledger: Ledger

    def __init__(
        self, folder: Path, client: Client, params: Mapping[str, Any], settle: float = 2.0
    ) -> None:
        self.folder = folder
        self.client = client
        self.params = dict(params)
        self.settle = settle
        self._lock: IO[str] | None = None
        self._changing: dict[str, tuple[tuple[int, int], float]] = {}

    def __enter__(self) -> FolderWatch:
        self._lock = (self.folder / _LOCK).open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise CannotWatch(f"Another process watches {self.folder}.") from None
        self.ledger = Ledger(self.folder / _LEDGER)
        return self

    def __exit__(self, *exception: object) -> None:
        self.ledger.close()
        if self._lock is not None:
            self._lock.close()

    def look(self) -> None:
        """Submit what is new, and fetch what is finished."""
        try:
            scans = self._scans()
        except OSError as error:
            log.warning("%s cannot be read: %s", self.folder, error)
            return
        gone = self.ledger.entries.keys() - scans.keys()
        self.ledger.forget({n for n in gone if self.ledger.entries[n].state in ("done", "failed")})
        for name, path in scans.items():
            self._step(name, lambda path=path, name=name: self._notice(name, path))
        for name in list(self.ledger.entries):
            self._step(name, lambda name=name: self._advance(name))

    def _step(self, name: str, action: Any) -> None:
        try:
            action()
        except ApiError as error:
            if error.code == "invalid_params":
                raise CannotWatch(str(error)) from error
            if error.status in _LATER:
                log.warning("%s: %s It is tried again.", name, error)
            else:
                self._failed(name, error.code, str(error))
        except (ClientError, OSError) as error:
            log.warning("%s: %s It is tried again.", name, error)

    def _scans(self) -> dict[str, Path]:
        return {
            path.name: path
            for path in sorted(self.folder.iterdir())
            if path.suffix.lower() in SCANS
            and not path.name.startswith(".")
            and not path.name.endswith(".mesh.ply")
            and path.is_file()
        }

    def _notice(self, name: str, path: Path) -> None:
        """Write a new or changed file down once it has settled."""
        state = path.stat()
        entry = self.ledger.entries.get(name)
        mark = (state.st_size, state.st_mtime_ns)
        if entry is not None and (entry.size, entry.changed_ns) == mark:
            return
        now = time.monotonic()
        seen, since = self._changing.get(name, (None, now))
        if seen != mark:
            self._changing[name] = mark, now
            since = now
        if now - since < self.settle:
            return
        self._changing.pop(name, None)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        if entry is not None and entry.sha256 == digest:
            new = entry.evolve(size=state.st_size, changed_ns=state.st_mtime_ns)
        else:
            new = Entry(
                state.st_size,
                state.st_mtime_ns,
                digest,
                new_key(),
                self._prefix(name, path.stem),
                begun_at=time.time(),
            )
        self.ledger.put(name, new)

    def _prefix(self, name: str, stem: str) -> str:
        """Results are named after the scan; a second scan of the same stem gets its full name."""
        taken = {e.prefix for other, e in self.ledger.entries.items() if other != name}
        return name if stem in taken else stem

    def _advance(self, name: str) -> None:
        entry = self.ledger.entries[name]
        if entry.state == "submitting":
            job = self._earlier(name, entry) or self.client.submit(
                self.folder / name, idempotency_key=entry.key, **self.params
            )
            log.info("%s is job %s", name, job.id)
            self.ledger.put(name, entry.evolve(state="submitted", job_id=job.id))
        elif entry.state == "submitted":
            self._collect(name, entry, self.client.get(str(entry.job_id)))

    def _earlier(self, name: str, entry: Entry) -> Job | None:
        """The job of a submission that was made so long ago that its key is forgotten."""
        if time.time() - entry.begun_at < _KEY_SECONDS:
            return None
        for job in self.client.jobs(q=name):
            if job.raw["scan"]["sha256"] == entry.sha256:
                return job
        return None

    def _collect(self, name: str, entry: Entry, job: Job) -> None:
        if not job.is_finished:
            return
        if job.status != "succeeded":
            self._failed(
                name, job.error_code or job.status, job.error_detail or "It was cancelled."
            )
            return
        for artifact in _RESULTS:
            if artifact in job.artifacts:
                self.client.download(job.id, artifact, self.folder / f"{entry.prefix}.{artifact}")
        (self.folder / f"{entry.prefix}.error.txt").unlink(missing_ok=True)
        log.info("%s is done", name)
        self.ledger.put(name, entry.evolve(state="done"))

    def _failed(self, name: str, code: str, detail: str) -> None:
        entry = self.ledger.entries[name]
        log.error("%s failed: %s: %s", name, code, detail)
        report = self.folder / f"{entry.prefix}.error.txt"
        report.write_text(f"{code}: {detail}\n")
        self.ledger.put(name, entry.evolve(state="failed"))
