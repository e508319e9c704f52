"""Removing what nobody needs any more: old jobs, abandoned uploads, spent keys, stray files."""

from __future__ import annotations

import logging
import shutil
import time
from datetime import timedelta
from pathlib import Path

from sqlalchemy import delete, select

from service.db import Database, utc_now
from service.jobs.model import IdempotencyKey, Job, WorkerRecord
from service.jobs.service import remove_job
from service.jobs.state import TERMINAL
from service.settings import Settings
from service.storage import Storage
from service.uploads.model import Upload
from service.webhooks.model import Delivery

log = logging.getLogger(__name__)
_BATCH = 100
_DAY = timedelta(days=1)
_STRAY_SECONDS = 86_400.0


class Sweeper:
    """Rows go first and bytes after the commit: bytes without a row are found by nobody."""

    def __init__(self, database: Database, storage: Storage, settings: Settings) -> None:
        self.database = database
        self.storage = storage
        self.settings = settings

    def run(self) -> None:
        self.sweep_jobs()
        self.sweep_uploads()
        self.sweep_records()
        sweep_strays(self.settings.data_dir / "tmp")

    def sweep_jobs(self) -> int:
        """Delete finished jobs past their retention with all their bytes."""
        before = utc_now() - timedelta(seconds=self.settings.retention_seconds)
        statement = select(Job.id).where(Job.status.in_(TERMINAL), Job.finished_at < before)
        with self.database.read() as session:
            old = session.scalars(statement.limit(_BATCH)).all()
        for job_id in old:
            with self.database.transaction() as unit:
                job = unit.session.get(Job, job_id)
                keys = [] if job is None else remove_job(unit.session, job)
            self.storage.delete_all(f"artifacts/{job_id}/")
            for key in keys:
                self.storage.delete(key)
        return len(old)

    def sweep_uploads(self) -> int:
        """Delete uploads past their time that no job reads."""
        used = select(Job.id).where(Job.upload_id == Upload.id).exists()
        statement = select(Upload.id).where(Upload.expires_at < utc_now(), ~used)
        with self.database.read() as session:
            old = session.scalars(statement.limit(_BATCH)).all()
        removed = 0
        for upload_id in old:
            with self.database.transaction() as unit:
                gone = delete(Upload).where(
                    Upload.id == upload_id, Upload.expires_at < utc_now(), ~used
                )
                found = unit.session.execute(gone).rowcount  # type: ignore[attr-defined]
            if found:
                self.storage.delete_all(f"uploads/{upload_id}/")
                removed += 1
        return removed

    def sweep_records(self) -> None:
        now = utc_now()
        keys_before = now - timedelta(seconds=self.settings.idempotency_seconds)
        with self.database.transaction() as unit:
            session = unit.session
            session.execute(delete(IdempotencyKey).where(IdempotencyKey.created_at < keys_before))
            session.execute(delete(WorkerRecord).where(WorkerRecord.seen_at < now - _DAY))
            settled = Delivery.next_at.is_(None) & (Delivery.created_at < now - 7 * _DAY)
            session.execute(delete(Delivery).where(settled))


def sweep_strays(folder: Path) -> None:
    """Remove what processes that were killed have left: files, and folders of attempts."""
    before = time.time() - _STRAY_SECONDS
    for path in folder.glob("*"):
        try:
            if path.lstat().st_mtime >= before:
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        except OSError as error:
            log.debug("%s stays: %s", path, error)
