"""Taking jobs in: replayed submissions, quotas, and the insert that makes a job exist."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.auth.principal import Principal
from service.db import Database, Transaction, utc_now
from service.errors import ServiceError
from service.jobs.model import PRIORITIES, IdempotencyKey, Job
from service.jobs.params import hard_limit_seconds
from service.jobs.queries import live_workers, one_job
from service.jobs.queues import Bell
from service.jobs.repository import JobRepository
from service.quotas import check_queued, check_stored, hold_owner
from service.settings import Settings
from service.uploads.model import Upload


@dataclass(frozen=True)
class Submission:
    """A job to be. ``source`` identifies the scan in the fingerprint: its hash or upload id."""

    principal: Principal
    params: Mapping[str, Any]
    source: str
    idempotency_key: str | None = None
    retry_of: str | None = None

    @property
    def fingerprint(self) -> str:
        parts = [self.params, self.source, self.retry_of]
        text = json.dumps(parts, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class Accepted:
    """The job that a submission made, or, when ``replayed``, had made before."""

    job_id: str
    replayed: bool = False


class JobIntake:
    """Accepts submissions; used by the upload and the retry calls alike."""

    def __init__(self, database: Database, bell: Bell, settings: Settings) -> None:
        self.database = database
        self.bell = bell
        self.settings = settings

    def replay(self, submission: Submission) -> Accepted | None:
        """The job of an earlier submission with the same key.

        Raises ServiceError ``idempotency_conflict`` when that had another body.
        """
        with self.database.read() as session:
            return self._replay(session, submission)

    def check_quota(self, principal: Principal) -> None:
        """Raises ServiceError ``quota_queued``."""
        with self.database.read() as session:
            check_queued(session, principal.owner, self.settings.quota_queued)

    def accept(self, submission: Submission, upload: Upload) -> Accepted:
        """Make the job, and the upload where it is new; the workers hear of it after the commit.

        Raises ServiceError (``idempotency_conflict``, ``quota_queued``, ``quota_storage``).
        """
        try:
            with self.database.transaction() as unit:
                hold_owner(unit.session, submission.principal.owner)
                earlier = self._replay(unit.session, submission)
                if earlier is not None:
                    return earlier
                self._check_quotas(unit.session, submission.principal.owner, upload)
                return Accepted(self._insert(unit, submission, upload).id)
        except IntegrityError:
            # Another call with the same key was first.
            earlier = self.replay(submission)
            if earlier is None:
                raise
            return earlier

    def _insert(self, unit: Transaction, submission: Submission, upload: Upload) -> Job:
        params = submission.params
        job = Job(
            owner=submission.principal.owner,
            label=params.get("label"),
            priority=PRIORITIES.index(params.get("priority", "normal")),
            device_class=self._device_class(unit.session, params.get("device", "auto")),
            params=dict(params),
            callback_url=params.get("callback_url"),
            upload=unit.session.merge(upload),
            retry_of=submission.retry_of,
            enqueued_at=utc_now(),
        )
        JobRepository(unit.session).add(job)
        if submission.idempotency_key is not None:
            self._remember(unit.session, submission, job)
        limit = hard_limit_seconds(params, self.settings.hard_limit_seconds)
        unit.after_commit(lambda: self.bell.enqueue(job.id, job.device_class, job.priority, limit))
        return job

    def _remember(self, session: Session, submission: Submission, job: Job) -> None:
        key = submission.idempotency_key
        stale = session.get(IdempotencyKey, (job.owner, key))
        if stale is not None:
            session.delete(stale)
            session.flush()
        session.add(
            IdempotencyKey(
                owner=job.owner, key=key, fingerprint=submission.fingerprint, job_id=job.id
            )
        )

    def _replay(self, session: Session, submission: Submission) -> Accepted | None:
        if submission.idempotency_key is None:
            return None
        owner = submission.principal.owner
        record = session.get(IdempotencyKey, (owner, submission.idempotency_key))
        kept = timedelta(seconds=self.settings.idempotency_seconds)
        if record is None or record.created_at < utc_now() - kept:
            return None
        if record.fingerprint != submission.fingerprint:
            raise ServiceError(
                "idempotency_conflict",
                "Use a new Idempotency-Key for another scan or other params.",
            )
        if one_job(session, record.job_id, owner) is None:
            return None
        return Accepted(record.job_id, replayed=True)

    def _check_quotas(self, session: Session, owner: str, upload: Upload) -> None:
        check_queued(session, owner, self.settings.quota_queued)
        if session.get(Upload, upload.id) is None:
            check_stored(session, owner, upload.size, self.settings.quota_bytes)

    def _device_class(self, session: Session, asked: str) -> str:
        if asked != "auto":
            return asked
        since = utc_now() - timedelta(seconds=self.settings.lease_seconds)
        classes = {worker.device_class for worker in live_workers(session, since)}
        return "cuda" if "cuda" in classes else "cpu"
