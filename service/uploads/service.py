"""Uploads from their creation to the stored scan."""

from __future__ import annotations

import tempfile
import uuid
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.auth.principal import Principal
from service.db import Database, new_id, utc_now
from service.errors import ServiceError
from service.quotas import check_stored, hold_owner
from service.settings import Settings
from service.storage import Storage, StorageFull
from service.uploads.inspection import Inspection, Length, check_head, inspect_file
from service.uploads.model import Upload, UploadPart
from service.uploads.received import (
    ReceivedFile,
    Receiver,
    clean_name,
    storage_full,
    too_large,
)


class UploadService:
    """Pieces are stored as they come and joined when the last one is there.

    No process holds anything of an upload in memory: the next piece may reach another one.
    """

    def __init__(self, database: Database, storage: Storage, settings: Settings) -> None:
        self.database = database
        self.storage = storage
        self.settings = settings
        self.folder = settings.data_dir / "tmp"
        self.folder.mkdir(parents=True, exist_ok=True)

    def receive_scan(self, name: str, length: Length) -> Receiver:
        """Takes a whole scan in."""
        name = clean_name(name)
        judge = partial(check_head, length=length, name=name, settings=self.settings)
        return Receiver(self.folder, name, self.settings.max_upload_bytes, judge)

    def receive_piece(self, upload: Upload, offset: int) -> Receiver:
        """Takes a part of an upload in; the first one shows what it is of."""
        length = Length(upload.size, exact=True)
        judge = partial(check_head, length=length, name=upload.name, settings=self.settings)
        left = upload.size - offset
        return Receiver(self.folder, upload.name, left, None if offset else judge)

    def check_room(self, principal: Principal, size: int) -> None:
        """Raises ServiceError (``too_large``, ``storage_full``, ``quota_storage``)."""
        most = self.settings.max_upload_bytes
        if size > most:
            raise too_large(most)
        free = self.storage.free_bytes()
        if free is not None and free < size:
            raise storage_full()
        with self.database.read() as session:
            check_stored(session, principal.owner, size, self.settings.quota_bytes)

    def create(self, principal: Principal, name: str, size: int) -> Upload:
        self.check_room(principal, size)
        upload = self._blank(principal, name, size)
        with self.database.transaction() as unit:
            hold_owner(unit.session, principal.owner)
            check_stored(unit.session, principal.owner, size, self.settings.quota_bytes)
            unit.session.add(upload)
        return self.complete(upload) if size == 0 else upload

    def get(self, principal: Principal, upload_id: str) -> Upload:
        """Raises ServiceError (``upload_not_found``, ``upload_expired``)."""
        with self.database.read() as session:
            upload = session.get(Upload, upload_id)
        owner = principal.visible_owner
        if upload is None or (owner is not None and upload.owner != owner):
            raise ServiceError("upload_not_found", "Check the id, or create a new upload.")
        if not upload.is_complete and upload.expires_at < utc_now():
            raise ServiceError("upload_expired", "Create a new upload and send the scan again.")
        return upload

    def append(self, upload: Upload, offset: int, piece: ReceivedFile) -> Upload:
        """Store a piece at ``offset``. Raises ServiceError (``offset_mismatch``, …)."""
        key = f"uploads/{upload.id}/{offset:016d}-{uuid.uuid4().hex}"
        try:
            self._put(key, piece.path)
            with self.database.transaction() as unit:
                row = _locked(unit.session, upload.id)
                check_offset(row, offset)
                row.offset += piece.size
                row.expires_at = self._expiry()
                part = UploadPart(upload_id=row.id, offset=offset, size=piece.size, key=key)
                unit.session.add(part)
        except ServiceError:
            self.storage.delete(key)
            raise
        finally:
            piece.discard()
        return self.complete(row) if row.offset == row.size else row

    def complete(self, upload: Upload) -> Upload:
        """Join the pieces and read the header; harmless when it is done again."""
        with self.database.read() as session:
            statement = select(UploadPart).where(UploadPart.upload_id == upload.id)
            parts = list(session.scalars(statement.order_by(UploadPart.offset)))
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            joined = self._join(upload, parts, Path(folder))
            inspection = inspect_file(joined.path, self.settings.max_points)
            key = self._store(upload.id, joined)
        with self.database.transaction() as unit:
            row = _locked(unit.session, upload.id)
            _describe(row, key, joined.sha256, inspection)
            unit.session.execute(delete(UploadPart).where(UploadPart.upload_id == row.id))
        for part in parts:
            self.storage.delete(part.key)
        return row

    def usable(self, principal: Principal, upload_id: str) -> Upload:
        """A complete upload that can be read as a scan. Raises ServiceError."""
        upload = self.get(principal, upload_id)
        if not upload.is_complete:
            if upload.offset < upload.size:
                raise ServiceError(
                    "upload_incomplete",
                    f"Send the rest first: {upload.offset:,} of {upload.size:,} bytes are here.",
                )
            upload = self.complete(upload)
        if upload.refusal_code is not None:
            raise ServiceError(upload.refusal_code, upload.refusal_detail or "")
        return upload

    def inspect(self, received: ReceivedFile) -> Inspection:
        """What a received file's header says. Raises ServiceError for what is no scan."""
        inspection = inspect_file(received.path, self.settings.max_points)
        if inspection.refusal is not None:
            raise inspection.refusal
        return inspection

    def keep(self, principal: Principal, received: ReceivedFile, seen: Inspection) -> Upload:
        """Store the bytes; the row is new and not in the database yet."""
        upload = self._blank(principal, received.name, received.size)
        upload.offset = received.size
        _describe(upload, self._store(upload.id, received), received.sha256, seen)
        return upload

    def delete(self, principal: Principal, upload_id: str) -> None:
        """Remove an upload; its bytes stay as long as jobs need them."""
        from service.jobs.model import Job

        upload = self.get(principal, upload_id)
        with self.database.transaction() as unit:
            row = _locked(unit.session, upload.id)
            used = unit.session.scalar(select(Job.id).where(Job.upload_id == row.id).limit(1))
            if used is not None:
                return
            unit.session.delete(row)
        self.storage.delete_all(f"uploads/{upload.id}/")

    def discard_bytes(self, upload: Upload) -> None:
        self.storage.delete_all(f"uploads/{upload.id}/")

    def _blank(self, principal: Principal, name: str, size: int) -> Upload:
        return Upload(
            id=new_id(),
            owner=principal.owner,
            name=clean_name(name),
            size=size,
            offset=0,
            expires_at=self._expiry(),
        )

    def _join(self, upload: Upload, parts: list[UploadPart], folder: Path) -> ReceivedFile:
        with Receiver(folder, upload.name, upload.size) as receiver:
            for part in parts:
                for chunk in self.storage.read(part.key):
                    receiver.write(chunk)
            return receiver.keep()

    def _store(self, upload_id: str, received: ReceivedFile) -> str:
        key = f"uploads/{upload_id}/scan{received.path.suffix}"
        self._put(key, received.path)
        return key

    def _put(self, key: str, path: Path) -> None:
        try:
            self.storage.put(key, path)
        except StorageFull:
            raise storage_full() from None

    def _expiry(self) -> datetime:
        return utc_now() + timedelta(seconds=self.settings.upload_lifetime_seconds)


def check_offset(upload: Upload, offset: int) -> None:
    """Raises ServiceError ``offset_mismatch``."""
    if upload.offset != offset:
        raise ServiceError(
            "offset_mismatch",
            f"Ask with HEAD where the upload stands and continue there: at byte {upload.offset}.",
            headers={"Upload-Offset": str(upload.offset)},
        )


def _describe(upload: Upload, key: str, sha256: str, inspection: Inspection) -> None:
    upload.key, upload.sha256, upload.points = key, sha256, inspection.points
    if inspection.refusal is not None:
        upload.refusal_code = inspection.refusal.code
        upload.refusal_detail = inspection.refusal.detail


def _locked(session: Session, upload_id: str) -> Upload:
    statement = select(Upload).where(Upload.id == upload_id).with_for_update()
    upload = session.scalars(statement.execution_options(populate_existing=True)).first()
    if upload is None:
        raise ServiceError("upload_not_found", "Create a new upload and send the scan again.")
    return upload
