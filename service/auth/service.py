"""Making, checking and revoking API keys."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import select

from service.auth.model import ApiKey
from service.auth.principal import Principal
from service.db import Database, new_id, utc_now
from service.errors import ServiceError

_KEY = re.compile(r"visco_([0-9a-z]{26})_([A-Za-z0-9_-]{43})")


@dataclass(frozen=True)
class NewKey:
    """A key just made; ``secret`` is shown once and never stored."""

    record: ApiKey
    secret: str


class KeyService:
    """API keys. The secret has 256 random bits, so that a plain SHA-256 of it is enough."""

    def __init__(self, database: Database) -> None:
        self.database = database

    def create(self, name: str, owner: str, scopes: Sequence[str]) -> NewKey:
        key_id = new_id()
        secret = f"visco_{key_id}_{secrets.token_urlsafe(32)}"
        record = ApiKey(
            id=key_id, owner=owner, name=name, secret_hash=_digest(secret), scopes=list(scopes)
        )
        with self.database.transaction() as unit:
            unit.session.add(record)
        return NewKey(record, secret)

    def all(self) -> list[ApiKey]:
        with self.database.read() as session:
            return list(session.scalars(select(ApiKey).order_by(ApiKey.id)))

    def revoke(self, key_id: str) -> bool:
        """False when there is no such key."""
        with self.database.transaction() as unit:
            record = unit.session.get(ApiKey, key_id)
            if record is None:
                return False
            record.revoked_at = record.revoked_at or utc_now()
            return True

    def any_active(self) -> bool:
        with self.database.read() as session:
            statement = select(ApiKey.id).where(ApiKey.revoked_at.is_(None)).limit(1)
            return session.scalar(statement) is not None

    def check(self, secret: str) -> Principal:
        """Whom a key stands for. Raises ServiceError ``invalid_key``."""
        refusal = ServiceError(
            "invalid_key", "Send a key made by `visco keys create` that is not revoked."
        )
        match = _KEY.fullmatch(secret)
        if match is None:
            raise refusal
        with self.database.read() as session:
            record = session.get(ApiKey, match[1])
        known = record is not None and hmac.compare_digest(record.secret_hash, _digest(secret))
        if not known or record is None or record.revoked_at is not None:
            raise refusal
        return Principal(record.owner, frozenset(record.scopes), record.id)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
