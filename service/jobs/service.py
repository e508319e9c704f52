"""What users do with jobs once they exist: look, cancel, retry, delete."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.auth.principal import Principal
from service.db import Database
from service.errors import ServiceError
from service.jobs.model import Artifact, IdempotencyKey, Job
from service.jobs.params import check_params
from service.jobs.queries import JobFilter, job_page, one_job, queue_positions
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.jobs.submission import Accepted, JobIntake, Submission
from service.storage import Storage
from service.uploads.model import Upload


class JobService:
    """One transaction a call; watchers and workers hear of it after the commit."""

    def __init__(self, database: Database, storage: Storage, bell: Bell, intake: JobIntake) -> None:
        self.database = database
        self.storage = storage
        self.bell = bell
        self.intake = intake

    def get(self, principal: Principal, job_id: str) -> tuple[Job, int | None]:
        """The job and its queue position. Raises ServiceError ``job_not_found``."""
        with self.database.read() as session:
            job = _visible(session, principal, job_id)
            return job, queue_positions(session, [job_id]).get(job_id)

    def page(
        self, wanted: JobFilter, before: str | None, limit: int
    ) -> tuple[list[Job], dict[str, int]]:
        """At most ``limit`` jobs, newest first, and the positions of the queued ones."""
        with self.database.read() as session:
            jobs = job_page(session, wanted, before, limit)
            queued = [job.id for job in jobs if job.status == "queued"]
            return jobs, queue_positions(session, queued)

    def cancel(self, principal: Principal, job_id: str) -> None:
        """Cancelling a cancelled job is no error; raises ServiceError ``job_finished``."""
        with self.database.transaction() as unit:
            repository = JobRepository(unit.session)
            job = _visible(unit.session, principal, job_id)
            job = repository.lock(job_id) or job
            if job.status == "cancelled":
                return
            if job.is_terminal:
                raise ServiceError(
                    "job_finished", f"The job has {job.status}; only an unfinished one can stop."
                )
            repository.cancel(job)
            unit.after_commit(lambda: self.bell.ring(job_id))

    def retry(
        self,
        principal: Principal,
        job_id: str,
        changes: Mapping[str, Any],
        idempotency_key: str | None,
    ) -> Accepted:
        """A new job of the same scan with changed params.

        Raises ServiceError (``job_not_found``, ``job_not_finished``, ``invalid_params``).
        """
        job, _ = self.get(principal, job_id)
        if not job.is_terminal:
            raise ServiceError(
                "job_not_finished", "Cancel the job or wait for its end before it is retried."
            )
        params = check_params({**job.params, **changes})
        submission = Submission(principal, params, job.upload_id, idempotency_key, job.id)
        return self.intake.accept(submission, job.upload)

    def delete(self, principal: Principal, job_id: str) -> None:
        """Remove a job in any state with all its bytes; a running attempt loses its lease."""
        with self.database.transaction() as unit:
            job = _visible(unit.session, principal, job_id)
            keys = remove_job(unit.session, job)
            unit.after_commit(lambda: self._removed(job_id, keys))

    def artifacts(self, principal: Principal, job_id: str) -> list[Artifact]:
        job, _ = self.get(principal, job_id)
        return list(job.artifacts)

    def artifact(self, principal: Principal, job_id: str, name: str) -> Artifact:
        """Raises ServiceError ``artifact_not_found``."""
        for artifact in self.artifacts(principal, job_id):
            if artifact.name == name:
                return artifact
        raise ServiceError(
            "artifact_not_found",
            f"See /v1/jobs/{job_id}/artifacts for the files that the job has left.",
        )

    def _removed(self, job_id: str, keys: list[str]) -> None:
        self.bell.ring(job_id)
        self.storage.delete_all(f"artifacts/{job_id}/")
        for key in keys:
            self.storage.delete(key)


def remove_job(session: Session, job: Job) -> list[str]:
    """Delete the rows of a job; returns the keys of scan bytes that no job needs any more."""
    upload_id, scan_key = job.upload_id, job.upload.key
    session.execute(delete(IdempotencyKey).where(IdempotencyKey.job_id == job.id))
    session.delete(job)
    session.flush()
    if session.scalar(select(Job.id).where(Job.upload_id == upload_id).limit(1)):
        return []
    session.execute(delete(Upload).where(Upload.id == upload_id))
    return [scan_key] if scan_key else []


def _visible(session: Session, principal: Principal, job_id: str) -> Job:
    job = one_job(session, job_id, principal.visible_owner)
    if job is None:
        raise ServiceError(
            "job_not_found", "Check the id; a job is deleted some time after it has ended."
        )
    return job
