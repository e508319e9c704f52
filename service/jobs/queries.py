"""Reading jobs: pages, queue positions and counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session, selectinload

from service.jobs.model import Event, Job, WorkerRecord
from service.jobs.state import Status
from service.uploads.model import Upload


@dataclass(frozen=True)
class JobFilter:
    """Which jobs a page holds; ``owner`` None means everyone's."""

    owner: str | None
    statuses: Sequence[Status] = ()
    label: str | None = None
    search: str | None = None


def job_page(session: Session, wanted: JobFilter, before: str | None, limit: int) -> list[Job]:
    """At most ``limit`` jobs, newest first, older than the id ``before``."""
    statement = _matching(select(Job), wanted)
    if before is not None:
        statement = statement.where(Job.id < before)
    statement = statement.order_by(Job.id.desc()).limit(limit)
    return list(session.scalars(statement.options(*_details())))


def one_job(session: Session, job_id: str, owner: str | None) -> Job | None:
    statement = select(Job).where(Job.id == job_id)
    if owner is not None:
        statement = statement.where(Job.owner == owner)
    return session.scalars(statement.options(*_details())).first()


def _details() -> tuple:
    return selectinload(Job.attempts), selectinload(Job.artifacts)


def _matching(statement: Select[Job], wanted: JobFilter) -> Select[Job]:
    if wanted.owner is not None:
        statement = statement.where(Job.owner == wanted.owner)
    if wanted.statuses:
        statement = statement.where(Job.status.in_(wanted.statuses))
    if wanted.label is not None:
        statement = statement.where(Job.label == wanted.label)
    if wanted.search:
        pattern = f"%{_escaped(wanted.search)}%"
        named = select(Upload.id).where(Upload.name.ilike(pattern, escape="\\"))
        statement = statement.where(
            Job.label.ilike(pattern, escape="\\") | Job.upload_id.in_(named)
        )
    return statement


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("%", "\\%").replace("_", "\\_")


def queue_positions(session: Session, job_ids: Sequence[str]) -> dict[str, int]:
    """1 for the job that a worker of its device class takes next."""
    if not job_ids:
        return {}
    place = func.row_number().over(
        partition_by=Job.device_class, order_by=(Job.priority.desc(), Job.id)
    )
    ranked = select(Job.id, place.label("place")).where(Job.status == "queued").subquery()
    rows = session.execute(select(ranked.c.id, ranked.c.place).where(ranked.c.id.in_(job_ids)))
    return {row.id: row.place for row in rows}


def events_after(session: Session, job_id: str, sequence: int, limit: int = 500) -> list[Event]:
    statement = select(Event).where(Event.job_id == job_id, Event.sequence > sequence)
    return list(session.scalars(statement.order_by(Event.sequence).limit(limit)))


def status_counts(session: Session) -> dict[Status, int]:
    rows = session.execute(select(Job.status, func.count()).group_by(Job.status))
    return {row[0]: row[1] for row in rows}


def queue_depths(session: Session) -> dict[tuple[str, int], int]:
    """(device class, priority) -> queued jobs."""
    statement = (
        select(Job.device_class, Job.priority, func.count())
        .where(Job.status == "queued")
        .group_by(Job.device_class, Job.priority)
    )
    return {(device, priority): count for device, priority, count in session.execute(statement)}


def live_workers(session: Session, since: datetime) -> list[WorkerRecord]:
    statement = select(WorkerRecord).where(WorkerRecord.seen_at >= since)
    return list(session.scalars(statement.order_by(WorkerRecord.id)))
