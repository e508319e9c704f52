"""Telling a callback_url how a job ended."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from servicekit import add_job, make_settings, running_api, submit
from standardwebhooks import Webhook, WebhookVerificationError

from service.db import Database, utc_now
from service.errors import ServiceError
from service.jobs.repository import JobRepository
from service.settings import Settings
from service.webhooks.model import Delivery
from service.webhooks.retry import next_delay
from service.webhooks.sender import WebhookSender
from service.webhooks.signature import new_secret, shared_secret, signed_headers
from service.webhooks.target import TargetRefused, check_callback, resolve


class Receiver(ThreadingHTTPServer):
    """Takes webhooks and remembers them; answers with ``status`` after some ``seconds``."""

    def __init__(self) -> None:
        self.status = 204
        self.location = ""
        self.seconds = 0.0
        self.seen: list[tuple[dict[str, str], bytes]] = []
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def url(self) -> str:
        return f"http://localhost:{self.server_port}/hook?part=7"


class _Handler(BaseHTTPRequestHandler):
    server: Receiver

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        self.server.seen.append(({k.lower(): v for k, v in self.headers.items()}, body))
        time.sleep(self.server.seconds)
        self.send_response(self.server.status)
        if self.server.location:
            self.send_header("Location", self.server.location)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, *args: Any) -> None:
        pass


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    server = Receiver()
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path, webhook_allow_private=True)


@pytest.fixture
def sender(database: Database, settings: Settings) -> Iterator[WebhookSender]:
    opened = WebhookSender(database, settings)
    yield opened
    opened.close()


def finish_job(database: Database, url: str) -> None:
    job = add_job(database, callback_url=url)
    with database.transaction() as unit:
        repository = JobRepository(unit.session)
        locked = repository.lock(job.id)
        assert locked is not None
        repository.cancel(locked)


def only_delivery(database: Database) -> Delivery:
    with database.read() as session:
        return session.query(Delivery).one()


def test_a_receiver_that_follows_the_standard_accepts_the_signature() -> None:
    secret, body = new_secret(), b'{"type": "job.succeeded"}'
    now = int(utc_now().timestamp())
    headers = signed_headers(secret, "msg_1", now, body)
    assert Webhook(secret).verify(body, headers) == json.loads(body)
    with pytest.raises(WebhookVerificationError):
        Webhook(secret).verify(body + b" ", headers)


def test_the_end_of_a_job_is_delivered_once_and_signed(
    database: Database, settings: Settings, sender: WebhookSender, receiver: Receiver
) -> None:
    finish_job(database, receiver.url)
    assert sender.send_due() == 1
    assert sender.send_due() == 0
    ((headers, body),) = receiver.seen
    payload = Webhook(shared_secret(database, settings)).verify(body, headers)
    assert payload["type"] == "job.cancelled"
    assert headers["host"] == f"localhost:{receiver.server_port}"
    assert only_delivery(database).delivered_at is not None


def test_a_service_that_stops_ends_the_delivery_under_way_and_begins_no_other(
    database: Database, settings: Settings, receiver: Receiver
) -> None:
    receiver.seconds = 0.5
    for _ in range(2):
        finish_job(database, receiver.url)
    with running_api(settings):
        while not receiver.seen:
            time.sleep(0.01)
    with database.read() as session:
        deliveries = session.query(Delivery).all()
    assert sorted((d.tries, d.delivered_at is not None) for d in deliveries) == [
        (0, False),
        (1, True),
    ]


def test_a_failed_delivery_is_tried_again_under_the_same_id(
    database: Database, sender: WebhookSender, receiver: Receiver
) -> None:
    receiver.status = 503
    finish_job(database, receiver.url)
    sender.send_due()
    waiting = only_delivery(database)
    assert waiting.next_at is not None
    assert utc_now() < waiting.next_at < utc_now() + timedelta(seconds=6)
    with database.transaction() as unit:
        unit.session.get_one(Delivery, waiting.id).next_at = utc_now()
    receiver.status = 200
    sender.send_due()
    assert len({headers["webhook-id"] for headers, _ in receiver.seen}) == 1
    assert only_delivery(database).next_at is None


def test_a_redirect_is_not_followed(
    database: Database, sender: WebhookSender, receiver: Receiver
) -> None:
    receiver.status, receiver.location = 307, receiver.url
    finish_job(database, receiver.url)
    sender.send_due()
    assert len(receiver.seen) == 1
    assert only_delivery(database).last_error == "The receiver said 307."


def test_tries_end_after_more_than_a_day() -> None:
    delays = [next_delay(tries) for tries in range(1, 20)]
    kept = [delay for delay in delays if delay is not None]
    assert kept == sorted(kept)
    assert sum(kept, timedelta()) > timedelta(days=1)
    assert delays[-1] is None


def test_two_processes_share_one_secret(database: Database, settings: Settings) -> None:
    assert shared_secret(database, settings) == shared_secret(database, settings)


@pytest.mark.parametrize(
    "url",
    [
        "http://127.0.0.1/", "http://localhost/", "http://10.0.0.1/", "http://192.168.1.1:8000/",
        "http://169.254.169.254/latest/meta-data", "http://[::1]/", "http://[::ffff:10.0.0.1]/",
        "http://0.0.0.0/", "http://100.64.0.1/", "http://224.0.0.1/", "http://[fd00::1]/",
        "http://2130706433/", "http://0x7f.1/", "http://x.localhost/",
    ],
)  # fmt: skip
def test_private_addresses_are_never_called(url: str) -> None:
    with pytest.raises(TargetRefused):
        resolve(url, allow_private=False)


@pytest.mark.parametrize(
    "url", ["ftp://example.com/", "example.com", "http://", "http://a:b@example.com/",
            "http://example.com/a b", "http://example.com:99999/", "http://[::1/"],
)  # fmt: skip
def test_what_is_no_web_address_is_refused_at_submission(url: str) -> None:
    with pytest.raises(ServiceError) as caught:
        check_callback(url, allow_private=True)
    assert caught.value.code == "callback_refused"


def test_the_connection_goes_to_the_address_that_was_checked() -> None:
    target = resolve("http://localhost:81/a?b=c", allow_private=True)
    assert target.pinned_url in ("http://127.0.0.1:81/a?b=c", "http://[::1]:81/a?b=c")
    assert target.host_header == "localhost:81"


def test_a_job_with_a_private_callback_is_refused(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path)) as client:
        refused: httpx.Response = submit(client, callback_url="http://127.0.0.1/hook")
    assert (refused.status_code, refused.json()["code"]) == (422, "callback_refused")
    assert refused.json()["errors"][0]["path"] == "params.callback_url"
