"""What one owner may have at most.

A count is only exact for those who hold the owner: without that, two calls at once could each see
room for one more.
"""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db import hold
from service.errors import ServiceError
from service.jobs.model import Artifact, Job
from service.jobs.state import Status
from service.uploads.model import Upload


def hold_owner(session: Session, owner: str) -> None:
    """Keep the owner's numbers as they are until the transaction ends."""
    hold(session, f"owner:{owner}")


def check_queued(session: Session, owner: str, most: int) -> None:
    """Raises ServiceError ``quota_queued`` where there is no room for one more job."""
    if most and count_jobs(session, owner, "queued") >= most:
        raise ServiceError(
            "quota_queued",
            f"Wait until some of your {most} queued jobs have started.",
            headers={"Retry-After": "30"},
        )


def check_stored(session: Session, owner: str, more: int, most: int) -> None:
    """Raises ServiceError ``quota_storage`` where there is no room for ``more`` bytes."""
    used = stored_bytes(session, owner) if most else 0
    if used + more > most > 0:
        raise ServiceError(
            "quota_storage",
            f"Delete finished jobs first: {used:,} of your {most:,} bytes are used.",
        )


def count_jobs(session: Session, owner: str, status: Status) -> int:
    statement = select(func.count()).where(Job.owner == owner, Job.status == status)
    return session.scalar(statement) or 0


def stored_bytes(session: Session, owner: str) -> int:
    """Bytes of the owner's uploads and artifacts."""
    uploads = select(func.coalesce(func.sum(Upload.size), 0)).where(Upload.owner == owner)
    artifacts = (
        select(func.coalesce(func.sum(Artifact.size), 0)).join(Job).where(Job.owner == owner)
    )
    return int(session.scalar(uploads) or 0) + int(session.scalar(artifacts) or 0)
