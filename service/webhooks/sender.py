"""Delivering webhooks: claimed in the database, so that several API processes share the work."""

from __future__ import annotations

import json
import logging
import time
from datetime import timedelta

import httpx
from sqlalchemy import select

from service.db import Database, utc_now
from service.settings import Settings
from service.webhooks.model import Delivery
from service.webhooks.retry import next_delay
from service.webhooks.signature import shared_secret, signed_headers
from service.webhooks.target import TargetRefused, resolve

log = logging.getLogger(__name__)
_TIMEOUT_SECONDS = 10.0
# While one process calls, the others leave the delivery alone for this long.
_CLAIM = timedelta(seconds=60)


class WebhookSender:
    """Sends what is due. A try that ends without a word is due again after the claim."""

    def __init__(self, database: Database, settings: Settings) -> None:
        self.database = database
        self.settings = settings
        self._stopping = False
        self._client = httpx.Client(
            timeout=_TIMEOUT_SECONDS, follow_redirects=False, trust_env=False
        )

    def stop(self) -> None:
        """Begin no further delivery; the one under way goes on."""
        self._stopping = True

    def close(self) -> None:
        self._client.close()

    def send_due(self) -> int:
        """Make one try for each delivery that is due; returns their number."""
        tried = 0
        while not self._stopping and (delivery := self._claim()) is not None:
            error = self._call(delivery)
            self._settle(delivery.id, error)
            tried += 1
        return tried

    def _claim(self) -> Delivery | None:
        now = utc_now()
        with self.database.read() as session:
            due = select(Delivery.id).where(Delivery.next_at <= now).limit(1)
            if session.scalar(due) is None:
                return None
        with self.database.transaction() as unit:
            statement = select(Delivery).where(Delivery.next_at <= now).order_by(Delivery.next_at)
            delivery = unit.session.scalars(
                statement.limit(1).with_for_update(skip_locked=True)
            ).first()
            if delivery is not None:
                delivery.tries += 1
                delivery.next_at = now + _CLAIM
            return delivery

    def _call(self, delivery: Delivery) -> str | None:
        """None when the receiver took it; otherwise what went wrong."""
        try:
            target = resolve(delivery.url, self.settings.webhook_allow_private)
        except TargetRefused as error:
            return str(error)
        body = json.dumps(delivery.payload).encode()
        secret = shared_secret(self.database, self.settings)
        headers = {
            **signed_headers(secret, delivery.id, int(time.time()), body),
            "Content-Type": "application/json",
            "User-Agent": "visco-webhooks",
            "Host": target.host_header,
        }
        extensions = {"sni_hostname": target.host} if target.secure else {}
        try:
            with self._client.stream(
                "POST", target.pinned_url, content=body, headers=headers, extensions=extensions
            ) as answer:
                return None if answer.is_success else f"The receiver said {answer.status_code}."
        except httpx.HTTPError as error:
            return f"{type(error).__name__}: {error}"

    def _settle(self, delivery_id: str, error: str | None) -> None:
        with self.database.transaction() as unit:
            delivery = unit.session.get(Delivery, delivery_id)
            if delivery is None:
                return
            delivery.last_error = error[:500] if error else None
            if error is None:
                delivery.delivered_at, delivery.next_at = utc_now(), None
                return
            delay = next_delay(delivery.tries)
            delivery.next_at = None if delay is None else utc_now() + delay
            log.warning("Webhook %s of job %s: %s", delivery.id, delivery.job_id, error)
