"""The worker's parent process: it takes messages, watches its child, and never touches torch."""

from __future__ import annotations

import logging
import os
import threading
from importlib.metadata import version

from sqlalchemy import select, update

from service.db import Database, utc_now
from service.jobs.model import Attempt, Job, WorkerRecord
from service.jobs.queues import Bell
from service.jobs.reaper import Reaper
from service.jobs.repository import JobRepository, LeaseLost
from service.jobs.sweeper import sweep_strays
from service.settings import Settings
from worker.failures import hard_limit_failure
from worker.identity import WorkerIdentity, device_name

log = logging.getLogger(__name__)
_parent: Parent | None = None
_RELEASE_SECONDS = 0.3


class Parent:
    """A thread that shows that the worker is there, and reaps what other workers lost."""

    def __init__(self, settings: Settings, identity: WorkerIdentity, queues: list[str]) -> None:
        self.settings = settings
        self.identity = identity
        self.database = Database(settings.sqlalchemy_url)
        self.bell = Bell(settings)
        self.reaper = Reaper(self.database, self.bell, settings)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="parent", daemon=True)
        now = utc_now()
        self._record = {
            "id": identity.name,
            "device_class": identity.device_class,
            # Only the child may ask CUDA for a name; attempts show it.
            "device": "cuda" if identity.device_class == "cuda" else device_name("cpu"),
            "queues": queues,
            "pid": os.getpid(),
            "version": version("visco"),
            "started_at": now,
        }

    def start(self) -> None:
        global _parent
        _parent = self
        self._thread.start()

    def close(self) -> None:
        """Take the worker off the list."""
        self._ended.set()
        self._thread.join()
        with self.database.transaction() as unit:
            record = unit.session.get(WorkerRecord, self.identity.name)
            if record is not None:
                unit.session.delete(record)
        self.database.dispose()

    def release(self) -> None:
        """Ask this worker's running attempts to give their jobs back, until the worker ends.

        Asked again and again, since a job may be claimed between the first time and the end.
        """
        threading.Thread(target=self._release, name="release", daemon=True).start()

    def _release(self) -> None:
        statement = (
            update(Attempt)
            .where(Attempt.worker == self.identity.name, Attempt.finished_at.is_(None))
            .values(release_requested=True)
        )
        while not self._ended.is_set():
            with self.database.transaction() as unit:
                unit.session.execute(statement)
            self._ended.wait(_RELEASE_SECONDS)

    def lose_child(self, job_id: str) -> None:
        """The child that ran the job is dead: its attempt need not wait for its lease."""
        attempt = self._own_attempt(job_id)
        if attempt is not None:
            self.reaper.lose(job_id, attempt)

    def fail_child(self, job_id: str, seconds: float) -> None:
        """The child that ran the job had to be killed: the job would hang again."""
        attempt = self._own_attempt(job_id)
        if attempt is None:
            return
        try:
            with self.database.transaction() as unit:
                JobRepository(unit.session).fail(job_id, attempt, *hard_limit_failure(seconds))
        except LeaseLost:
            return
        self.bell.ring(job_id)

    def _own_attempt(self, job_id: str) -> int | None:
        """The number of the job's latest attempt, if this worker makes it."""
        statement = select(Attempt.number).join(Job, Job.id == Attempt.job_id)
        statement = statement.where(
            Job.id == job_id, Job.attempt == Attempt.number, Attempt.worker == self.identity.name
        )
        with self.database.read() as session:
            return session.scalar(statement)

    def _watch(self) -> None:
        # On a machine without an API nobody else does.
        sweep_strays(self.settings.data_dir / "tmp")
        while True:
            try:
                with self.database.transaction() as unit:
                    unit.session.merge(WorkerRecord(**self._record, seen_at=utc_now()))
                self.reaper.run()
            except Exception:
                log.exception("The worker's watch failed; it is tried again")
            if self._ended.wait(self.settings.reap_seconds):
                return


def child_lost(job_id: str) -> None:
    """Called in the parent for a task whose child died."""
    if _parent is not None:
        _parent.lose_child(job_id)


def child_hung(job_id: str, seconds: float) -> None:
    """Called in the parent for a task whose child was killed because it took too long."""
    if _parent is not None:
        _parent.fail_child(job_id, seconds)
