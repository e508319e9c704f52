"""Submitting once, although the network may try twice."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, running_api, sphere_scan, submit

from service.db import Database, utc_now
from service.jobs.model import IdempotencyKey
from service.settings import Settings

KEY = {"Idempotency-Key": "scan-0001"}


def test_the_same_key_and_body_give_the_same_job(api: httpx.Client) -> None:
    first = submit(api, headers=KEY, resolution=64)
    again = submit(api, headers=KEY, resolution=64)
    assert (first.status_code, again.status_code) == (202, 202)
    assert first.json()["id"] == again.json()["id"]
    assert again.headers["Idempotency-Replayed"] == "true"
    assert len(api.get("/v1/jobs").json()["jobs"]) == 1


def test_the_same_key_with_another_body_is_a_conflict(api: httpx.Client) -> None:
    submit(api, headers=KEY, resolution=64)
    for other in (
        submit(api, headers=KEY, resolution=65),
        submit(api, sphere_scan(201), headers=KEY, resolution=64),
    ):
        assert (other.status_code, other.json()["code"]) == (409, "idempotency_conflict")


def test_a_key_is_forgotten_after_its_time(
    api: httpx.Client, database: Database, settings: Settings
) -> None:
    first = submit(api, headers=KEY)
    with database.transaction() as unit:
        record = unit.session.get_one(IdempotencyKey, ("local", KEY["Idempotency-Key"]))
        record.created_at = utc_now() - timedelta(seconds=settings.idempotency_seconds + 1)
    second = submit(api, headers=KEY)
    assert second.status_code == 202
    assert first.json()["id"] != second.json()["id"]


def test_a_storm_of_equal_submissions_makes_one_job(api: httpx.Client) -> None:
    with ThreadPoolExecutor(6) as pool:
        answers = list(pool.map(lambda _: submit(api, headers=KEY), range(6)))
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1


def test_a_replayed_submission_leaves_no_bytes_behind(
    api: httpx.Client, settings: Settings
) -> None:
    for _ in range(3):
        submit(api, headers=KEY)
    stored = [path for path in (settings.data_dir / "storage").rglob("*") if path.is_file()]
    assert len(stored) == 1
    assert not list((settings.data_dir / "tmp").iterdir())


def test_a_full_queue_is_refused_with_the_time_to_wait(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path, quota_queued=1)) as client:
        assert submit(client).status_code == 202
        refused = submit(client)
    assert (refused.status_code, refused.json()["code"]) == (429, "quota_queued")
    assert int(refused.headers["Retry-After"]) > 0


@pytest.mark.parametrize("key", ["", "x" * 256])
def test_an_unfit_key_is_refused(api: httpx.Client, key: str) -> None:
    refused = submit(api, headers={"Idempotency-Key": key})
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")
