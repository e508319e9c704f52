"""Holding a job: heartbeats from a thread, and the answers to «should this attempt stop?»."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable
from datetime import timedelta

from sqlalchemy import select

from service.db import Database
from service.jobs.model import Attempt, Job
from service.jobs.repository import JobRepository, LeaseLost
from service.settings import Settings

log = logging.getLogger(__name__)
# A cancel is seen after the first of these and done after both: within the promised second.
POLL_SECONDS = 0.2
OBEY_SECONDS = 0.5


class Lease:
    """The lease of one attempt; use as a context manager around its work.

    A thread renews the lease until the work ends, and looks whether it should stop. A solver that
    was told to stop and is deep in a long step is not waited for: ``on_overdue`` ends the attempt,
    and the solver finds out at its next look. Past ``hard_limit`` seconds the solve is taken for
    hung: ``on_hung`` is called and this process killed, since nothing else stops native code.
    """

    def __init__(
        self,
        database: Database,
        settings: Settings,
        job_id: str,
        attempt: int,
        hard_limit: float,
        on_overdue: Callable[[], None],
        on_hung: Callable[[], None],
    ) -> None:
        self.database = database
        self.job_id = job_id
        self.attempt = attempt
        self._span = timedelta(seconds=settings.lease_seconds)
        self._interval = settings.heartbeat_seconds
        self._deadline = time.monotonic() + hard_limit
        self._on_overdue = on_overdue
        self._on_hung = on_hung
        self._parent = os.getppid()
        self._ended = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="lease", daemon=True)

    def __enter__(self) -> Lease:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._thread.join()

    def should_stop(self) -> bool:
        """Whether the job was cancelled, given back or taken away."""
        return self._stop.is_set()

    def _watch(self) -> None:
        renew_at = time.monotonic() + self._interval
        while not self._ended.is_set():
            now = time.monotonic()
            if now >= self._deadline:
                self._give_up()
            if now >= renew_at:
                renew_at = now + self._interval
                self._renew()
            if not self._stop.is_set() and self._asked_to_stop():
                self._stop.set()
                if not self._ended.wait(OBEY_SECONDS):
                    self._end_overdue()
            self._ended.wait(POLL_SECONDS)

    def _asked_to_stop(self) -> bool:
        if os.getppid() != self._parent:
            # The worker's parent is gone, and with it whoever would restart this process.
            return True
        statement = (
            select(Job.cancel_requested, Job.attempt, Job.status, Attempt.release_requested)
            .join(Attempt, (Attempt.job_id == Job.id) & (Attempt.number == self.attempt))
            .where(Job.id == self.job_id)
        )
        try:
            with self.database.read() as session:
                row = session.execute(statement).first()
        except Exception as error:  # noqa: BLE001  the lease decides when it is away for long
            log.warning("Job %s cannot be asked for: %s", self.job_id, error)
            return False
        if row is None or row.attempt != self.attempt or row.status != "running":
            return True
        return row.cancel_requested or row.release_requested

    def _renew(self) -> None:
        try:
            with self.database.transaction() as unit:
                JobRepository(unit.session).renew(self.job_id, self.attempt, self._span)
        except LeaseLost:
            self._stop.set()
        except Exception as error:  # noqa: BLE001  the next beat tries again
            log.warning("The lease of job %s was not renewed: %s", self.job_id, error)

    def _end_overdue(self) -> None:
        try:
            self._on_overdue()
        except LeaseLost:
            log.debug("Job %s had gone to another attempt", self.job_id)
        except Exception as error:  # noqa: BLE001  the solver ends it at its next look
            log.warning("Job %s was not ended early: %s", self.job_id, error)

    def _give_up(self) -> None:
        log.error("Job %s passed its hard limit; its process is killed", self.job_id)
        try:
            self._on_hung()
        finally:
            os.kill(os.getpid(), signal.SIGKILL)
