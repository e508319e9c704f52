"""A runner over a real database and storage, with a solver that tests direct."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servicekit import make_settings, open_database, sphere_scan

from service.auth.principal import LOCAL_USER
from service.db import Database
from service.jobs.model import Artifact, Event, Job
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.settings import Settings
from service.storage import Storage, open_storage
from service.uploads.inspection import Length
from service.uploads.service import UploadService
from visco_core.config import ReconstructionConfig
from visco_core.pointcloud import PointCloud
from visco_core.progress import Progress
from visco_core.result import Mesh, Outcome, Reconstruction
from worker.identity import WorkerIdentity
from worker.runner import Runner
from worker.solver import Hooks

TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32))


@dataclass
class StandInSolver:
    """Reports two levels and gives a triangle; ``during`` happens in the middle of the solve."""

    during: Callable[[Hooks], None] = lambda hooks: None
    configs: list[ReconstructionConfig] = field(default_factory=list)
    cloud: PointCloud = field(default_factory=lambda: PointCloud(np.eye(3)))

    def warm_up(self) -> None:
        pass

    def reconstruct(
        self, scan: Path, max_points: int, config: ReconstructionConfig, hooks: Hooks
    ) -> Reconstruction:
        assert scan.read_bytes().startswith(b"ply")
        self.configs.append(config)
        hooks.on_progress(Progress("read", 0.1, 0.1))
        hooks.on_scan(self.cloud)
        for level in (1, 2):
            losses = {"point": 1.0 / level, "normal": float("nan")}
            hooks.on_progress(
                Progress("solve", 0.4 * level, 1.0, 2.0, level, 2, 32 * level, 1, 1, losses)
            )
            hooks.on_level(TRIANGLE, 32 * level)
            self.during(hooks)
        outcome = Outcome("complete", "All levels are done.", config.resolution)
        report = {"backend": "none", "phases": [{"phase": "prepare", "notes": ["Odd scan."]}]}
        return Reconstruction(TRIANGLE, outcome, report)

    def write(self, mesh: Mesh, path: Path, up_axis: str, metadata: Mapping | None) -> None:
        path.write_text(f"{path.suffix} {up_axis} {len(mesh.faces)}")

    def write_points(self, cloud: PointCloud, path: Path, up_axis: str) -> None:
        path.write_text(f"{len(cloud)} points {up_axis}")


@dataclass
class Bench:
    """Everything that a test of the runner looks at."""

    settings: Settings
    database: Database
    storage: Storage
    bell: Bell

    def runner(self, solver: StandInSolver, device: str = "cpu") -> Runner:
        identity = WorkerIdentity(f"test:{device}", device)  # type: ignore[arg-type]
        return Runner(
            self.database, self.storage, self.bell, self.settings, identity, "test device", solver
        )

    def submit(self, **params: Any) -> Job:
        uploads = UploadService(self.database, self.storage, self.settings)
        with uploads.receive_scan("scan.ply", Length()) as receiver:
            receiver.write(sphere_scan())
            received = receiver.keep()
        upload = uploads.keep(LOCAL_USER, received, uploads.inspect(received))
        job = Job(owner="local", params=params, device_class="cpu", upload=upload)
        with self.database.transaction() as unit:
            unit.session.add(upload)
            JobRepository(unit.session).add(job)
        return job

    def load(self, job: Job) -> Job:
        with self.database.read() as session:
            return session.get_one(Job, job.id)

    def events(self, job: Job) -> list[Event]:
        with self.database.read() as session:
            query = session.query(Event).where(Event.job_id == job.id)
            return query.order_by(Event.sequence).all()

    def artifacts(self, job: Job) -> dict[str, Artifact]:
        with self.database.read() as session:
            found = session.query(Artifact).where(Artifact.job_id == job.id).all()
        return {artifact.name: artifact for artifact in found}

    def content(self, artifact: Artifact) -> bytes:
        return b"".join(self.storage.read(artifact.key))

    def change(self, action: Callable[[JobRepository], object]) -> None:
        with self.database.transaction() as unit:
            action(JobRepository(unit.session))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    settings = make_settings(tmp_path, heartbeat_seconds=0.05)
    database = open_database(settings)
    bell = Bell(settings)
    yield Bench(settings, database, open_storage(settings), bell)
    bell.close()
    database.dispose()


@pytest.fixture
def solver() -> StandInSolver:
    return StandInSolver()
