"""One attempt at a job: claim → fetch → solve → store → finish."""

from __future__ import annotations

import dataclasses
import json
import logging
import tempfile
import time
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.db import Database
from service.jobs.model import Job
from service.jobs.params import core_config, hard_limit_seconds, wanted_outputs
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository, LeaseLost
from service.settings import Settings
from service.storage import Storage, StorageFull, StoredBytesMissing
from service.storage.base import file_sha256
from visco_core.errors import Stopped, VisCoError
from worker.failures import describe_failure, hard_limit_failure, is_out_of_memory
from worker.identity import WorkerIdentity
from worker.journal import Journal, LogCapture
from worker.lease import Lease
from worker.memory import solve_memory_bytes
from worker.solver import Hooks, Solver

if TYPE_CHECKING:
    from visco_core.config import ReconstructionConfig
    from visco_core.io.glb import UpAxis
    from visco_core.pointcloud import PointCloud
    from visco_core.result import Mesh, Reconstruction

log = logging.getLogger(__name__)
_COARSEST = 64
# As many as a browser draws smoothly.
_POINTS_SHOWN = 2_000_000


class InputLost(Exception):
    """The stored scan is not what was uploaded."""


@dataclasses.dataclass(frozen=True)
class Runner:
    """Runs jobs in this process, one at a time."""

    database: Database
    storage: Storage
    bell: Bell
    settings: Settings
    identity: WorkerIdentity
    device_name: str
    solver: Solver
    # How long each output of the last job took: what the next one will take, more or less.
    write_seconds: dict[str, float] = dataclasses.field(default_factory=dict)

    def run(self, job_id: str) -> None:
        """Make an attempt at the job, if it is still to be had; every end is stored."""
        job = self._claim(job_id)
        if job is None:
            log.info("Job %s is not to be had", job_id)
            return
        begun = time.monotonic()
        wanted = wanted_outputs(job.params)
        expected = sum(self.write_seconds.get(name, 0.0) for name in wanted)
        journal = Journal(self.database, self.storage, self.bell, job.id, job.attempt, expected)
        limit = hard_limit_seconds(job.params, self.settings.hard_limit_seconds)
        lease = Lease(
            self.database,
            self.settings,
            job.id,
            job.attempt,
            limit,
            on_overdue=journal.stop,
            on_hung=lambda: journal.fail(*hard_limit_failure(limit)),
        )
        folder = self.settings.data_dir / "tmp"
        folder.mkdir(parents=True, exist_ok=True)
        with LogCapture(journal), lease, tempfile.TemporaryDirectory(dir=folder) as work:
            attempt = _Attempt(self, job, journal, lease, Path(work), begun)
            try:
                attempt.execute()
            except LeaseLost:
                log.warning("Attempt %s of job %s is no longer its job's", job.attempt, job.id)

    def _claim(self, job_id: str) -> Job | None:
        with self.database.transaction() as unit:
            job = JobRepository(unit.session).claim(
                job_id,
                self.identity.name,
                self.device_name,
                timedelta(seconds=self.settings.lease_seconds),
                self.settings.quota_running,
            )
            unit.after_commit(lambda: self.bell.ring(job_id))
        return job


@dataclasses.dataclass(frozen=True)
class _Attempt:
    runner: Runner
    job: Job
    journal: Journal
    lease: Lease
    folder: Path
    begun: float

    def execute(self) -> None:
        """Raises LeaseLost; every other end is written into the journal."""
        try:
            result = self._work()
        except Stopped:
            self.journal.stop()
        except (StorageFull, StoredBytesMissing, InputLost, VisCoError, Exception) as error:
            if isinstance(error, LeaseLost):
                raise
            self._fail(error)
        else:
            self.journal.succeed(result)

    def _work(self) -> dict[str, Any]:
        scan = self._fetch()
        config = self._config()
        with ThreadPoolExecutor(1, "levels") as background:
            levels = _LevelWriter(self, background, config.up_axis)
            done, notes = self._solve_within_memory(scan, config, levels)
            levels.finish()
        self.journal.writing()
        self._store_outputs(done, config.up_axis, notes)
        return {
            "outcome": dataclasses.asdict(done.outcome),
            "vertices": len(done.mesh.vertices),
            "faces": len(done.mesh.faces),
            "notes": [*notes, *done.notes],
        }

    def _fetch(self) -> Path:
        upload = self.job.upload
        scan = self.folder / f"scan{Path(upload.name).suffix.lower()}"
        self.runner.storage.fetch(upload.key or "", scan)
        if file_sha256(scan) != upload.sha256:
            raise InputLost
        return scan

    def _config(self) -> ReconstructionConfig:
        settings, params = self.runner.settings, self.job.params
        config = core_config(
            params,
            device=self.runner.identity.device_class,
            threads=settings.worker_threads or None,
        )
        most = solve_memory_bytes(
            self.runner.identity.device_class,
            settings.worker_memory_bytes,
            config.budget.memory_bytes,
        )
        budget = dataclasses.replace(config.budget, memory_bytes=most)
        return dataclasses.replace(config, budget=budget)

    def _solve_within_memory(
        self, scan: Path, config: ReconstructionConfig, levels: _LevelWriter
    ) -> tuple[Reconstruction, list[str]]:
        """The result, and what the owner should know of how it came about."""
        try:
            return self._solve(scan, config, levels), []
        except Exception as error:
            smaller = self._smaller(config, error)
            if smaller is None:
                raise
        # Not before the clause has ended: the error holds the first try's frames and their memory.
        self.journal.note("degraded", {"detail": smaller.note})
        return self._solve(scan, smaller.config, levels), [smaller.note]

    def _solve(
        self, scan: Path, config: ReconstructionConfig, levels: _LevelWriter
    ) -> Reconstruction:
        hooks = Hooks(
            self.journal.progress, levels.scan, levels.write, self.lease.should_stop, self.begun
        )
        if self.lease.should_stop():
            raise Stopped
        self.journal.enter("read")
        most = self.runner.settings.max_points
        return self.runner.solver.reconstruct(scan, most, config, hooks)

    def _smaller(self, config: ReconstructionConfig, error: Exception) -> _Smaller | None:
        """Half the resolution after a device ran out of memory; None where that is no help."""
        if not is_out_of_memory(error) or self.runner.identity.device_class != "cuda":
            return None
        resolution = max(_COARSEST, config.resolution // 2)
        if resolution == config.resolution:
            return None
        note = (
            f"The device had too little memory for a resolution of {config.resolution}; "
            f"{resolution} was used instead."
        )
        return _Smaller(dataclasses.replace(config, resolution=resolution), note)

    def _store_outputs(self, done: Reconstruction, up_axis: UpAxis, notes: list[str]) -> None:
        identity = {"job": self.job.id, "label": self.job.label}
        for name in wanted_outputs(self.job.params):
            begun = time.monotonic()
            path = self.folder / name
            if name == "report.json":
                service = {"job_id": self.job.id, "attempt": self.job.attempt, "notes": notes}
                phases = {key: round(value, 4) for key, value in self.journal.phases.items()}
                report = {**done.report, "service": {**service, "phases": phases}}
                path.write_text(json.dumps(report, indent=2, default=str))
            elif name == "log.txt":
                self.journal.log(done.outcome.message)
                self._write_log(path)
            else:
                self.runner.solver.write(done.mesh, path, up_axis, identity)
            if self.lease.should_stop():
                raise Stopped
            self.journal.store(path, name)
            self.runner.write_seconds[name] = time.monotonic() - begun

    def _fail(self, error: Exception) -> None:
        code, detail = describe_failure(error)
        if code == "internal_error":
            log.error("Job %s failed", self.job.id, exc_info=error)
        self.journal.log(f"failed: {code}: {detail}")
        try:
            path = self.folder / "log.txt"
            self._write_log(path)
            self.journal.store(path, "log.txt")
        except (OSError, StorageFull) as problem:
            log.warning("The log of job %s was not stored: %s", self.job.id, problem)
        self.journal.fail(code, detail)

    def _write_log(self, path: Path) -> None:
        path.write_text("\n".join(self.journal.lines) + "\n")


@dataclasses.dataclass(frozen=True)
class _Smaller:
    config: ReconstructionConfig
    note: str


class _LevelWriter:
    """Stores the scan and each finished level's mesh as GLB beside the solve, which does not
    wait for it."""

    def __init__(self, attempt: _Attempt, background: ThreadPoolExecutor, up_axis: UpAxis) -> None:
        self.attempt = attempt
        self.background = background
        self.up_axis: UpAxis = up_axis
        self._pending: list[Future[None]] = []

    def scan(self, cloud: PointCloud) -> None:
        self._pending.append(self.background.submit(self._scan, cloud))

    def write(self, mesh: Mesh, resolution: int) -> None:
        self._pending.append(self.background.submit(self._write, mesh, resolution))

    def finish(self) -> None:
        """Wait for what is still being written. Raises what went wrong there."""
        for future in self._pending:
            future.result()

    def _scan(self, cloud: PointCloud) -> None:
        import numpy as np

        # In random order, so that a viewer can draw the first few of them as a thinner scan.
        known = np.flatnonzero(np.isfinite(cloud.points).all(axis=1))
        chosen = np.random.default_rng(0).permutation(known)[:_POINTS_SHOWN]
        if not len(chosen):
            return
        path = self.attempt.folder / "scan.glb"
        self.attempt.runner.solver.write_points(cloud.select(chosen), path, self.up_axis)
        self.attempt.journal.store(path, path.name, "scan", points=len(chosen))

    def _write(self, mesh: Mesh, resolution: int) -> None:
        path = self.attempt.folder / f"level-{resolution}.glb"
        self.attempt.runner.solver.write(mesh, path, self.up_axis, None)
        self.attempt.journal.store(
            path,
            path.name,
            "level",
            resolution=resolution,
            vertices=len(mesh.vertices),
            faces=len(mesh.faces),
        )
