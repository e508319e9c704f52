"""The same service over PostgreSQL, Redis and S3, as on many machines."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path

import boto3
import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from backendkit import running_postgres, running_redis, running_s3
from servicekit import (
    add_job,
    free_port,
    make_settings,
    open_database,
    read_events,
    running_api,
    sphere_scan,
    submit,
    write_events_at_once,
)
from workerkit import Service

from service.auth.principal import Principal
from service.auth.service import KeyService
from service.db import Database, new_id
from service.db.migrate import migrate
from service.db.tables import metadata
from service.errors import ServiceError
from service.jobs.model import Job
from service.jobs.repository import JobRepository
from service.settings import Settings
from service.storage import StoredBytesMissing, open_storage
from service.uploads.service import UploadService

LEASE = timedelta(seconds=60)


@pytest.fixture(scope="module")
def postgres() -> Iterator[str]:
    with running_postgres() as url:
        yield url


@pytest.fixture
def credentials(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
        "NO_PROXY": "127.0.0.1",
    }.items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def settings(tmp_path: Path, postgres: str, credentials: None) -> Iterator[Settings]:
    with running_redis(tmp_path / "redis") as redis, running_s3("scans") as endpoint:
        yield make_settings(
            tmp_path,
            lease_seconds=4.0,
            heartbeat_seconds=0.5,
            database_url=postgres,
            redis_url=redis,
            storage_url="s3://scans/visco",
            s3_endpoint_url=endpoint,
        )


def stored_keys(settings: Settings) -> list[str]:
    client = boto3.client("s3", endpoint_url=settings.s3_endpoint_url)
    return [item["Key"] for item in client.list_objects_v2(Bucket="scans").get("Contents", [])]


def test_a_job_runs_over_postgres_redis_and_s3(settings: Settings, tmp_path: Path) -> None:
    elsewhere = settings.model_copy(update={"data_dir": tmp_path / "b", "port": settings.port})
    with running_api(settings) as api, Service(elsewhere, api).worker():
        job_id = submit(api, sphere_scan(2000), resolution=64).json()["id"]
        assert read_events(api, job_id)[-1]["event"] == "succeeded"
        mesh = api.get(f"/v1/jobs/{job_id}/artifacts/mesh.ply").content
        assert mesh.startswith(b"ply")
        url = f"/v1/jobs/{job_id}/artifacts/mesh.ply"
        assert api.get(url, headers={"Range": "bytes=10-19"}).content == mesh[10:20]
        assert all(key.startswith("visco/") for key in stored_keys(settings))
        assert api.delete(f"/v1/jobs/{job_id}").status_code == 204
        assert stored_keys(settings) == []
        assert api.get("/readyz").status_code == 200


def test_an_upload_in_pieces_is_joined_in_object_storage(settings: Settings) -> None:
    scan = sphere_scan(500)
    with running_api(settings) as api:
        place = api.post("/v1/uploads", headers={"Upload-Length": str(len(scan))}).headers[
            "Location"
        ]
        for start in range(0, len(scan), 20_000):
            headers = {
                "Content-Type": "application/offset+octet-stream",
                "Upload-Offset": str(start),
            }
            sent = api.patch(place, content=scan[start : start + 20_000], headers=headers)
            assert sent.status_code == 204
        assert api.get(place).json()["complete"]
        (key,) = stored_keys(settings)
    stored = b"".join(open_storage(settings).read(key.removeprefix("visco/")))
    assert stored == scan


def test_object_storage_says_what_is_missing(settings: Settings, tmp_path: Path) -> None:
    storage = open_storage(settings)
    with pytest.raises(StoredBytesMissing):
        storage.read("nothing")
    with pytest.raises(StoredBytesMissing):
        storage.fetch("nothing", tmp_path / "copy")
    storage.delete("nothing")
    storage.check()
    assert storage.free_bytes() is None


@pytest.fixture
def database(postgres: str) -> Iterator[Database]:
    opened = Database(postgres)
    migrate(opened)
    yield opened
    opened.dispose()


def test_the_migrations_make_the_models_tables_in_postgres(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_several_processes_may_migrate_postgres_at_once(postgres: str, tmp_path: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        for opened in pool.map(
            lambda _: open_database(make_settings(tmp_path, database_url=postgres)), range(4)
        ):
            opened.dispose()


def test_of_many_claims_at_once_one_gets_the_job(database: Database) -> None:
    job = add_job(database)

    def claim(number: int) -> Job | None:
        with database.transaction() as unit:
            return JobRepository(unit.session).claim(job.id, f"w{number}", "cpu", LEASE, 0)

    with ThreadPoolExecutor(8) as pool:
        claims = list(pool.map(claim, range(8)))
    assert sum(claimed is not None for claimed in claims) == 1


def test_of_many_claims_at_once_no_more_start_than_the_owner_may_run(database: Database) -> None:
    owner = new_id()
    jobs = [add_job(database, owner) for _ in range(8)]

    def claim(job: Job) -> Job | None:
        with database.transaction() as unit:
            return JobRepository(unit.session).claim(job.id, "w", "cpu", LEASE, 3)

    with ThreadPoolExecutor(8) as pool:
        claims = list(pool.map(claim, jobs))
    assert sum(claimed is not None for claimed in claims) == 3


def test_of_many_submissions_at_once_no_more_are_taken_than_the_quota(
    postgres: str, tmp_path: Path
) -> None:
    quotas = {"quota_queued": 3, "require_keys": True, "rate_limit_per_minute": 0}
    settings = make_settings(tmp_path, database_url=postgres, **quotas)
    opened = open_database(settings)
    secret = KeyService(opened).create("test", new_id(), ["read", "write"]).secret
    opened.dispose()
    key = {"X-API-Key": secret}
    second = settings.model_copy(update={"port": free_port()})
    with running_api(settings) as one, running_api(second) as other, ThreadPoolExecutor(12) as pool:
        answers = list(pool.map(lambda api: submit(api, headers=key), [one, other] * 6))
        jobs = one.get("/v1/jobs", headers=key).json()["jobs"]
    assert sorted(answer.status_code for answer in answers) == [202] * 3 + [429] * 9
    assert len(jobs) == 3


def test_of_many_uploads_at_once_no_more_are_begun_than_there_is_room_for(
    database: Database, tmp_path: Path
) -> None:
    settings = make_settings(tmp_path, quota_bytes=350)
    uploads = UploadService(database, open_storage(settings), settings)
    owner = Principal(new_id(), frozenset({"write"}))

    def create(_: int) -> str:
        try:
            uploads.create(owner, "scan.ply", 100)
        except ServiceError as refusal:
            return refusal.code
        return "begun"

    with ThreadPoolExecutor(8) as pool:
        assert sorted(pool.map(create, range(8))) == ["begun"] * 3 + ["quota_storage"] * 5


def test_many_writers_number_events_without_gap_in_postgres(database: Database) -> None:
    assert write_events_at_once(database) == list(range(1, 42))
