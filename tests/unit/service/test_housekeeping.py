"""What goes away by itself, and what operators can see."""

from __future__ import annotations

import os
import time
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from servicekit import add_job, submit

from service.db import Database, utc_now
from service.jobs.model import IdempotencyKey, Job, WorkerRecord
from service.jobs.sweeper import Sweeper, sweep_strays
from service.settings import Settings
from service.storage import open_storage
from service.webhooks.signature import shared_secret
from visco_core.cli import main


@pytest.fixture
def sweeper(database: Database, settings: Settings) -> Sweeper:
    return Sweeper(database, open_storage(settings), settings)


def age(database: Database, job_id: str, seconds: float) -> None:
    with database.transaction() as unit:
        job = unit.session.get_one(Job, job_id)
        job.finished_at = utc_now() - timedelta(seconds=seconds)


def test_finished_jobs_go_with_their_bytes_after_their_retention(
    api: httpx.Client, database: Database, settings: Settings, sweeper: Sweeper
) -> None:
    old, fresh, queued = (submit(api).json()["id"] for _ in range(3))
    for job_id in (old, fresh):
        api.post(f"/v1/jobs/{job_id}/cancel")
    age(database, old, settings.retention_seconds + 1)
    age(database, fresh, settings.retention_seconds - 60)
    assert sweeper.sweep_jobs() == 1
    left = {job["id"] for job in api.get("/v1/jobs").json()["jobs"]}
    assert left == {fresh, queued}
    stored = [p for p in (settings.data_dir / "storage").rglob("*") if p.is_file()]
    assert len(stored) == 2


def test_uploads_that_a_job_reads_are_kept_past_their_time(
    database: Database, sweeper: Sweeper
) -> None:
    add_job(database)
    assert sweeper.sweep_uploads() == 0


def test_spent_keys_and_gone_workers_are_forgotten(
    database: Database, settings: Settings, sweeper: Sweeper
) -> None:
    long_ago = utc_now() - timedelta(seconds=settings.idempotency_seconds, days=2)
    with database.transaction() as unit:
        for key, made in (("old", long_ago), ("new", utc_now())):
            unit.session.add(
                IdempotencyKey(owner="a", key=key, fingerprint="", job_id="", created_at=made)
            )
            unit.session.add(
                WorkerRecord(
                    id=key, device_class="cpu", device="cpu", queues=[], pid=1, version="1",
                    started_at=made, seen_at=made,
                )
            )  # fmt: skip
    sweeper.sweep_records()
    with database.read() as session:
        assert [record.key for record in session.query(IdempotencyKey)] == ["new"]
        assert [record.id for record in session.query(WorkerRecord)] == ["new"]


def test_only_old_strays_are_removed(tmp_path: Path) -> None:
    folder = tmp_path / "stray"
    for name, hours in (("old", 25), ("new", 0)):
        attempt, upload = folder / f"{name} attempt", folder / f"{name} upload"
        attempt.mkdir(parents=True)
        (attempt / "scan.ply").touch()
        upload.touch()
        for path in (attempt, upload):
            os.utime(path, (time.time() - hours * 3600,) * 2)
    sweep_strays(folder)
    assert {path.name for path in folder.iterdir()} == {"new attempt", "new upload"}


def test_metrics_tell_requests_jobs_and_queue_depth(api: httpx.Client) -> None:
    submit(api, priority="high")
    text = api.get("/metrics").text
    assert 'visco_jobs{status="queued"} 1.0' in text
    assert 'visco_queue_depth{device_class="cpu",priority="high"} 1.0' in text
    assert 'visco_http_requests_total{method="POST"' in text


def test_readiness_names_the_part_that_is_missing(api: httpx.Client) -> None:
    answer = api.get("/readyz")
    assert (answer.status_code, answer.json()["code"]) == (503, "not_ready")
    assert "broker" in answer.json()["detail"]
    assert api.get("/healthz").status_code == 200


def test_the_keys_command_makes_lists_and_revokes(
    settings: Settings,
    database: Database,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def visco(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(
            "sys.argv", ["visco", "keys", "--data-dir", str(settings.data_dir), *words]
        )
        return main(), capsys.readouterr().out.strip()

    status, secret = visco("create", "ci", "--owner", "ann", "--scope", "read")
    key_id = secret.split("_")[1]
    assert status == 0
    listed = visco("list")[1]
    assert key_id in listed
    assert secret not in listed
    assert visco("revoke", key_id)[0] == 0
    assert "revoked" in visco("list")[1]
    assert visco("revoke", "nope")[0] == 2
    assert visco("webhook-secret")[1] == shared_secret(database, settings)
