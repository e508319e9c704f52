"""Finding what fell through: attempts without a heartbeat, and jobs that no message names."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from datetime import timedelta

from sqlalchemy import ColumnElement, func, select, true
from sqlalchemy.orm import aliased

from service.db import Database, utc_now
from service.jobs.model import Job
from service.jobs.params import hard_limit_seconds
from service.jobs.queries import queue_depths
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.settings import Settings

log = logging.getLogger(__name__)
# A message needs a moment from the API through the broker to a worker that claims its job.
_PATIENCE = timedelta(seconds=5)
_BATCH = 200


class Reaper:
    """Any process may run it, several at once: every step checks again under the row's lock."""

    def __init__(self, database: Database, bell: Bell, settings: Settings) -> None:
        self.database = database
        self.bell = bell
        self.settings = settings

    def run(self) -> None:
        self.reap_lost()
        self.enqueue_forgotten()

    def reap_lost(self) -> list[str]:
        """Take jobs from attempts whose lease has run out; returns the jobs' ids."""
        with self.database.read() as session:
            suspects = JobRepository(session).expired(utc_now())
        return [job_id for job_id in suspects if self.lose(job_id, attempt=None)]

    def lose(self, job_id: str, attempt: int | None) -> bool:
        """Declare a running attempt lost; ``attempt`` None: if its lease has run out."""
        with self.database.transaction() as unit:
            repository = JobRepository(unit.session)
            job = repository.lock(job_id)
            if job is None or job.status != "running":
                return False
            if attempt is None:
                if job.lease_expires_at is None or job.lease_expires_at >= utc_now():
                    return False
            elif job.attempt != attempt:
                return False
            repository.lose(job, self.settings.max_lost_attempts)
            log.warning("Attempt %s of job %s was lost", job.attempt, job_id)
            unit.after_commit(lambda: self.bell.ring(job_id))
        return True

    def enqueue_forgotten(self) -> list[str]:
        """Send messages again for jobs of a queue that holds none; returns the jobs' ids.

        A queue with messages is left alone: its jobs are only waiting.
        """
        with self.database.read() as session:
            depths = queue_depths(session)
        sent: list[str] = []
        for device_class, priority in depths:
            try:
                empty = self.bell.waiting(device_class, priority) == 0
            except Exception as error:  # noqa: BLE001  tried again on the next run
                log.debug("The broker cannot be asked: %s", error)
                return sent
            sent += self._enqueue(device_class, priority, every=empty)
        return sent

    def _enqueue(self, device_class: str, priority: int, every: bool) -> list[str]:
        jobs = self._take(device_class, priority, every)
        for job in jobs:
            limit = hard_limit_seconds(job.params, self.settings.hard_limit_seconds)
            self.bell.enqueue(job.id, device_class, priority, limit)
        return [job.id for job in jobs]

    def _take(self, device_class: str, priority: int, every: bool) -> Sequence[Job]:
        """Jobs never enqueued since they were queued, or with ``every`` not for a while."""
        now = utc_now()
        forgotten = Job.enqueued_at.is_(None) & self._has_room()
        if every:
            forgotten = forgotten | (Job.enqueued_at < now - _PATIENCE)
        statement = (
            select(Job)
            .where(
                Job.status == "queued",
                Job.device_class == device_class,
                Job.priority == priority,
                forgotten,
            )
            .order_by(Job.id)
            .limit(_BATCH)
        )
        with self.database.read() as session:
            if session.scalars(statement.limit(1)).first() is None:
                return ()
        with self.database.transaction() as unit:
            jobs = unit.session.scalars(statement.with_for_update(of=Job, skip_locked=True)).all()
            for job in jobs:
                job.enqueued_at = now
        return jobs

    def _has_room(self) -> ColumnElement[bool]:
        """Whether a job's owner may run one more; messages for others would be in vain."""
        most = self.settings.quota_running
        if not most:
            return true()
        running = aliased(Job)
        owners = select(running.owner).where(running.status == "running").group_by(running.owner)
        return Job.owner.not_in(owners.having(func.count() >= most))
