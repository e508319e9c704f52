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
POLL_SECONDS = 0.2


class Lease:
    """The lease of one attempt; use as a context manager around its work.

    The thread renews the lease until the work ends. Past ``hard_limit`` seconds it takes the
    solve for hung, calls ``on_hung`` and kills this process: nothing else stops native code.
    """

    def __init__(
        self,
        database: Database,
        settings: Settings,
        job_id: str,
        attempt: int,
        hard_limit: float,
        on_hung: Callable[[], None],
    ) -> None:
        self.database = database
        self.job_id = job_id
        self.attempt = attempt
        self._span = timedelta(seconds=settings.lease_seconds)
        self._interval = settings.heartbeat_seconds
        self._deadline = time.monotonic() + hard_limit
        self._on_hung = on_hung
        self._parent = os.getppid()
        self._ended = threading.Event()
        self._stop = False
        self._next_poll = 0.0
        self._thread = threading.Thread(target=self._beat, name="lease", daemon=True)

    def __enter__(self) -> Lease:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._thread.join()

    def should_stop(self) -> bool:
        """Whether the job was cancelled, given back or taken away; asks at most every 0.2 s."""
        now = time.monotonic()
        if not self._stop and now >= self._next_poll:
            self._next_poll = now + POLL_SECONDS
            self._stop = self._asked_to_stop()
        return self._stop

    def _asked_to_stop(self) -> bool:
        statement = (
            select(Job.cancel_requested, Job.attempt, Job.status, Attempt.release_requested)
            .join(Attempt, (Attempt.job_id == Job.id) & (Attempt.number == self.attempt))
            .where(Job.id == self.job_id)
        )
        try:
            with self.database.read() as session:
                row = session.execute(statement).first()
        except Exception as error:  # noqa: BLE001  the heartbeat decides when it is away for long
            log.warning("Job %s cannot be asked for: %s", self.job_id, error)
            return False
        if row is None or row.attempt != self.attempt or row.status != "running":
            return True
        return row.cancel_requested or row.release_requested

    def _beat(self) -> None:
        while not self._ended.wait(self._wait_seconds()):
            if time.monotonic() >= self._deadline:
                self._give_up()
            if os.getppid() != self._parent:
                # The worker's parent is gone, and with it whoever would restart this process.
                self._stop = True
            self._renew()

    def _wait_seconds(self) -> float:
        return max(0.0, min(self._interval, self._deadline - time.monotonic()))

    def _renew(self) -> None:
        try:
            with self.database.transaction() as unit:
                JobRepository(unit.session).renew(self.job_id, self.attempt, self._span)
        except LeaseLost:
            self._stop = True
        except Exception as error:  # noqa: BLE001  the next beat tries again
            log.warning("The lease of job %s was not renewed: %s", self.job_id, error)

    def _give_up(self) -> None:
        log.error("Job %s passed its hard limit; its process is killed", self.job_id)
        try:
            self._on_hung()
        finally:
            os.kill(os.getpid(), signal.SIGKILL)
