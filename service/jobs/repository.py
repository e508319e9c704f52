"""Jobs in the database: one method a transition, each storing its event in the same breath."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.db import utc_now
from service.jobs.model import Artifact, Attempt, Event, Job
from service.jobs.state import AttemptOutcome, EventType, Status, Terminal, check_transition
from service.quotas import count_jobs, hold_owner
from service.webhooks.model import Delivery


class LeaseLost(Exception):
    """The attempt no longer holds its job: it may store nothing and should end."""


class JobRepository:
    """All changes of jobs. Methods that an attempt calls take its fencing number."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def add(self, job: Job) -> None:
        self.session.add(job)
        self.session.flush()
        self.record(job, "queued", {"attempt": 0})

    def lock(self, job_id: str) -> Job | None:
        """The job, held against other writers until the transaction ends."""
        statement = select(Job).where(Job.id == job_id).with_for_update(of=Job)
        return self.session.scalars(statement.execution_options(populate_existing=True)).first()

    def record(self, job: Job, type: EventType, data: Mapping[str, Any]) -> None:
        """Store an event; the job's row is locked, so that the sequence has no gap."""
        job.last_sequence += 1
        self.session.add(
            Event(job_id=job.id, sequence=job.last_sequence, type=type, data=dict(data))
        )

    def claim(
        self, job_id: str, worker: str, device: str, lease: timedelta, quota_running: int
    ) -> Job | None:
        """Start the next attempt; None when the job is not queued or its owner's quota is full."""
        job = self.lock(job_id)
        if job is None or job.status != "queued":
            return None
        if quota_running and self._is_full(job.owner, quota_running):
            # Its message is spent; the reaper sends another once there is room.
            job.enqueued_at = None
            return None
        now = utc_now()
        self._move(job, "running")
        job.attempt += 1
        job.started_at = now
        job.lease_expires_at = now + lease
        job.progress = None
        attempt = Attempt(
            job_id=job.id, number=job.attempt, worker=worker, device=device, started_at=now
        )
        self.session.add(attempt)
        self.record(job, "started", {"attempt": job.attempt, "worker": worker, "device": device})
        return job

    def renew(self, job_id: str, attempt: int, lease: timedelta) -> None:
        """Raises LeaseLost when the attempt's lease was given to another."""
        changed = self.session.execute(
            update(Job)
            .where(Job.id == job_id, Job.attempt == attempt, Job.status == "running")
            .values(lease_expires_at=utc_now() + lease)
        )
        if changed.rowcount == 0:  # type: ignore[attr-defined]
            raise LeaseLost(job_id)

    def held(self, job_id: str, attempt: int) -> Job:
        """The job, locked, if the attempt still holds it; raises LeaseLost otherwise."""
        job = self.lock(job_id)
        if job is None or job.attempt != attempt or job.status != "running":
            raise LeaseLost(job_id)
        return job

    def progress(self, job_id: str, attempt: int, progress: Mapping[str, Any]) -> None:
        job = self.held(job_id, attempt)
        job.progress = dict(progress)
        self.record(job, "progress", progress)

    def note(self, job_id: str, attempt: int, type: EventType, data: Mapping[str, Any]) -> None:
        """An event of a running attempt that changes nothing else."""
        self.record(self.held(job_id, attempt), type, data)

    def store_artifact(self, job_id: str, attempt: int, artifact: Artifact) -> str | None:
        """Record a stored output; returns the key of the one it replaces, if any."""
        self.held(job_id, attempt)
        old = self.artifact(job_id, artifact.name)
        replaced = None
        if old is not None:
            replaced = old.key
            self.session.delete(old)
            self.session.flush()
        self.session.add(artifact)
        return replaced if replaced != artifact.key else None

    def succeed(self, job_id: str, attempt: int, result: Mapping[str, Any]) -> None:
        job = self.held(job_id, attempt)
        job.result = dict(result)
        if job.progress is not None:
            job.progress = {**job.progress, "fraction": 1.0, "remaining_seconds": 0.0}
        self._end_attempt(job, "succeeded")
        self._finish(job, "succeeded", {"result": job.result})

    def fail(self, job_id: str, attempt: int, code: str, detail: str) -> None:
        job = self.held(job_id, attempt)
        self._end_attempt(job, "failed")
        self._fail(job, code, detail)

    def stop(self, job_id: str, attempt: int) -> None:
        """The running attempt obeyed: a cancelled job ends, another goes back to the queue."""
        job = self.held(job_id, attempt)
        if job.cancel_requested:
            self._end_attempt(job, "cancelled")
            self._finish(job, "cancelled", {})
        else:
            self._end_attempt(job, "released")
            self._requeue(job, "The worker stopped and gave the job back.")

    def cancel(self, job: Job) -> None:
        """A queued job ends at once; a running one is told to stop."""
        if job.status == "queued":
            job.cancel_requested = True
            self._finish(job, "cancelled", {})
        elif job.status == "running" and not job.cancel_requested:
            job.cancel_requested = True
            self.record(job, "cancel_requested", {})

    def lose(self, job: Job, max_lost_attempts: int) -> None:
        """The attempt's worker is gone: run the job again, unless that happened too often."""
        self._end_attempt(job, "lost")
        job.lost_attempts += 1
        if job.cancel_requested:
            self._finish(job, "cancelled", {})
        elif job.lost_attempts >= max_lost_attempts:
            self._fail(
                job,
                "worker_lost",
                f"{job.lost_attempts} workers were lost while they ran this job; try a lower "
                "resolution or a worker with more memory, and see the workers' logs.",
            )
        else:
            self._requeue(job, "The worker was lost.")

    def expired(self, now: datetime, limit: int = 100) -> Sequence[str]:
        """Running jobs whose lease has run out."""
        return self.session.scalars(
            select(Job.id)
            .where(Job.status == "running", Job.lease_expires_at < now)
            .order_by(Job.id)
            .limit(limit)
        ).all()

    def artifact(self, job_id: str, name: str) -> Artifact | None:
        statement = select(Artifact).where(Artifact.job_id == job_id, Artifact.name == name)
        return self.session.scalars(statement).first()

    def _is_full(self, owner: str, quota_running: int) -> bool:
        hold_owner(self.session, owner)
        return count_jobs(self.session, owner, "running") >= quota_running

    def _move(self, job: Job, target: Status) -> None:
        check_transition(job.status, target)
        job.status = target

    def _requeue(self, job: Job, why: str) -> None:
        self._move(job, "queued")
        job.lease_expires_at = None
        job.enqueued_at = None
        job.progress = None
        self.record(job, "requeued", {"attempt": job.attempt, "detail": why})

    def _fail(self, job: Job, code: str, detail: str) -> None:
        job.error_code, job.error_detail = code, detail[:2000]
        self._finish(job, "failed", {"error": {"code": code, "detail": job.error_detail}})

    def _finish(self, job: Job, status: Terminal, data: Mapping[str, Any]) -> None:
        self._move(job, status)
        job.finished_at = utc_now()
        job.lease_expires_at = None
        self.record(job, status, data)
        if job.callback_url:
            self.session.add(_delivery(job, data))

    def _end_attempt(self, job: Job, outcome: AttemptOutcome) -> None:
        attempt = self.session.get_one(Attempt, (job.id, job.attempt))
        attempt.outcome = outcome
        attempt.finished_at = utc_now()


def _delivery(job: Job, data: Mapping[str, Any]) -> Delivery:
    now = utc_now()
    payload = {
        "type": f"job.{job.status}",
        "timestamp": now.isoformat(),
        "data": {"id": job.id, "label": job.label, "status": job.status, **data},
    }
    return Delivery(job_id=job.id, url=job.callback_url, payload=payload, next_at=now)
