"""Signing by Standard Webhooks (https://www.standardwebhooks.com), version 1."""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets

from sqlalchemy import insert, select
from sqlalchemy.exc import IntegrityError

from service.db import Database
from service.settings import Settings
from service.webhooks.model import Secret

_PREFIX = "whsec_"
_NAME = "webhook"


def new_secret() -> str:
    return _PREFIX + base64.b64encode(secrets.token_bytes(32)).decode()


def signed_headers(secret: str, message_id: str, timestamp: int, body: bytes) -> dict[str, str]:
    """The three headers that a receiver checks with the shared secret."""
    key = base64.b64decode(secret.removeprefix(_PREFIX))
    signed = f"{message_id}.{timestamp}.".encode() + body
    digest = hmac.new(key, signed, hashlib.sha256).digest()
    return {
        "webhook-id": message_id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": f"v1,{base64.b64encode(digest).decode()}",
    }


def shared_secret(database: Database, settings: Settings) -> str:
    """The installation's signing secret: the configured one, or one made once and stored."""
    configured = settings.webhook_secret.get_secret_value()
    if configured:
        return configured
    statement = select(Secret.value).where(Secret.name == _NAME)
    with database.read() as session:
        stored = session.scalar(statement)
    if stored is not None:
        return stored
    try:
        with database.transaction() as unit:
            unit.session.execute(insert(Secret).values(name=_NAME, value=new_secret()))
    except IntegrityError:
        pass  # another process was first; its secret is the one
    with database.read() as session:
        return session.scalars(statement).one()
