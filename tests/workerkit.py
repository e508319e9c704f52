"""Workers, and what they leave: as processes for the tests that start and kill them."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
from servicekit import open_database, read_events, submit, until

from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.settings import Settings
from service.storage import open_storage
from visco_core.progress import Progress
from worker.journal import Journal

# A solve that goes on until somebody stops it.
ENDLESS = {"profile": "paper", "resolution": 64, "epochs": [1000]}


@dataclass
class Worker:
    """A worker as an operator starts it; it leads a process group of its own."""

    process: subprocess.Popen[bytes]
    name: str = ""

    def child(self) -> int:
        """The process that solves: the parent's one child that runs spawned code."""
        until(lambda: len(self._spawned_children()) == 1)
        return self._spawned_children()[0]

    def _spawned_children(self) -> list[int]:
        """None while the parent is between two children; ps would cut long paths off."""
        found = subprocess.run(
            ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(self.process.pid)],
            capture_output=True, text=True, check=False,
        ).stdout.splitlines()  # fmt: skip
        return [int(line.split()[0]) for line in found if "spawn_main" in line]

    def kill(self) -> None:
        """As when the machine loses power: parent and child at once."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def terminate(self) -> int:
        self.process.terminate()
        return self.process.wait(60)


@contextlib.contextmanager
def running_worker(settings: Settings, client: httpx.Client) -> Iterator[Worker]:
    """A worker that is ready to take jobs."""
    before = {worker["id"] for worker in client.get("/v1/info").json()["workers"]}
    process = subprocess.Popen(
        [sys.executable, "-m", "visco_core.cli", "worker", "--device", "cpu"],
        env={**os.environ, **settings.environment()},
        start_new_session=True,
    )
    worker = Worker(process)

    def came() -> bool:
        assert process.poll() is None, "the worker did not start"
        for found in client.get("/v1/info").json()["workers"]:
            if found["id"] not in before and f":{process.pid}:" in found["id"]:
                worker.name = found["id"]
        return bool(worker.name)

    try:
        until(came, 120)
        yield worker
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def finish_job(settings: Settings, job_id: str, folder: Path) -> None:
    """Write down what a worker would: an attempt that succeeded and left its log."""
    database, bell = open_database(settings), Bell(settings)
    with database.transaction() as unit:
        JobRepository(unit.session).claim(job_id, "test", "cpu", timedelta(minutes=1), 0)
    journal = Journal(database, open_storage(settings), bell, job_id, 1)
    journal.progress(Progress("solve", 0.5, 1.0, 1.0, 1, 2, 64, 1, 6, {"point": 0.1}))
    (folder / "log.txt").write_text("one line\n")
    journal.store(folder / "log.txt", "log.txt")
    outcome = {"code": "complete", "message": "Done.", "resolution": 64}
    journal.succeed({"outcome": outcome, "vertices": 3, "faces": 1})
    bell.close()
    database.dispose()


@dataclass
class Service:
    """The API's client, and how to add workers."""

    settings: Settings
    api: httpx.Client

    def worker(self) -> contextlib.AbstractContextManager[Worker]:
        return running_worker(self.settings, self.api)

    def start_endless(self, **params: Any) -> str:
        """Submit a solve without end; returns once it makes progress."""
        job_id = submit(self.api, **{**ENDLESS, **params}).json()["id"]
        self.wait_for_solving(job_id)
        return job_id

    def wait_for_solving(self, job_id: str, attempt: int = 1) -> None:
        def solving() -> bool:
            job = self.job(job_id)
            assert job["status"] in ("queued", "running"), job["error"]
            progress = job["progress"] or {}
            return progress.get("phase") == "solve" and progress.get("attempt") == attempt

        until(solving, 180)

    def job(self, job_id: str) -> dict[str, Any]:
        return self.api.get(f"/v1/jobs/{job_id}").json()

    def cancel(self, job_id: str) -> None:
        self.api.post(f"/v1/jobs/{job_id}/cancel")
        assert read_events(self.api, job_id)[-1]["event"] == "cancelled"
