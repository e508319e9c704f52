"""Keys, scopes, owners, hosts and limits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from servicekit import add_job, make_settings, open_database, running_api, running_broker

from service.auth.service import KeyService
from service.cli.api import refuse_open_door
from service.db import Database
from service.settings import Settings
from visco_core.errors import InputError


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path, require_keys=True)


@pytest.fixture
def keys(database: Database) -> KeyService:
    return KeyService(database)


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def test_only_a_hash_of_the_key_is_stored(keys: KeyService, settings: Settings) -> None:
    secret = keys.create("ci", "ann", ["read"]).secret
    for path in settings.data_dir.glob("visco.db*"):
        assert secret.split("_", 2)[2].encode() not in path.read_bytes()
    assert keys.check(secret).owner == "ann"


def test_without_a_key_nothing_is_served(api: httpx.Client) -> None:
    refused = api.get("/v1/jobs")
    assert (refused.status_code, refused.json()["code"]) == (401, "unauthenticated")
    assert refused.headers["WWW-Authenticate"] == "Bearer"
    assert api.get("/v1/healthz").status_code == 200


def test_an_unauthenticated_scan_is_refused_before_it_is_read(
    api: httpx.Client, settings: Settings
) -> None:
    refused = api.post("/v1/jobs", content=iter([b"x" * 100]))
    assert refused.status_code == 401
    assert not list((settings.data_dir / "tmp").iterdir())


@pytest.mark.parametrize("wrong", ["x", "visco_" + "0" * 26 + "_" + "a" * 43])
def test_an_unknown_key_is_refused(api: httpx.Client, wrong: str) -> None:
    assert api.get("/v1/jobs", headers={"X-API-Key": wrong}).status_code == 401


def test_a_revoked_key_is_refused_at_once(api: httpx.Client, keys: KeyService) -> None:
    new = keys.create("ci", "ann", ["read"])
    assert api.get("/v1/jobs", headers=bearer(new.secret)).status_code == 200
    assert keys.revoke(new.record.id)
    assert api.get("/v1/jobs", headers=bearer(new.secret)).json()["code"] == "invalid_key"


def test_owners_see_only_their_own_and_admins_all(
    api: httpx.Client, keys: KeyService, database: Database
) -> None:
    job = add_job(database, owner="ann")
    ann, bob = (keys.create("k", owner, ["read", "write"]).secret for owner in ("ann", "bob"))
    admin = keys.create("k", "root", ["admin"]).secret
    pages = [api.get("/v1/jobs", headers=bearer(key)).json() for key in (ann, bob, admin)]
    assert [len(page["jobs"]) for page in pages] == [1, 0, 1]
    for call in (
        api.get(f"/v1/jobs/{job.id}", headers=bearer(bob)),
        api.get(f"/v1/jobs/{job.id}/events", headers=bearer(bob)),
        api.get(f"/v1/jobs/{job.id}/artifacts/mesh.glb", headers=bearer(bob)),
        api.post(f"/v1/jobs/{job.id}/cancel", headers=bearer(bob)),
        api.delete(f"/v1/jobs/{job.id}", headers=bearer(bob)),
        api.get(f"/v1/uploads/{job.upload_id}", headers=bearer(bob)),
        api.post("/v1/jobs", files={"upload_id": (None, job.upload_id)}, headers=bearer(bob)),
    ):
        assert call.status_code == 404


def test_a_reading_key_changes_nothing(
    api: httpx.Client, keys: KeyService, database: Database
) -> None:
    job = add_job(database, owner="ann")
    reader = bearer(keys.create("k", "ann", ["read"]).secret)
    assert api.get(f"/v1/jobs/{job.id}", headers=reader).status_code == 200
    refused = api.post(f"/v1/jobs/{job.id}/cancel", headers=reader)
    assert (refused.status_code, refused.json()["code"]) == (403, "forbidden")


def test_the_service_refuses_to_open_its_door_without_keys(tmp_path: Path) -> None:
    settings = make_settings(tmp_path, host="0.0.0.0")
    assert settings.keys_needed
    with pytest.raises(InputError, match="visco keys create"):
        refuse_open_door(settings)
    database = open_database(settings)
    KeyService(database).create("k", "ann", ["read"])
    database.dispose()
    refuse_open_door(settings)
    refuse_open_door(make_settings(tmp_path))


def test_a_page_of_another_site_cannot_use_a_service_without_keys(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path)) as client:
        own = client.get("/v1/jobs", headers={"Origin": str(client.base_url)})
        foreign = client.get("/v1/jobs", headers={"Origin": "https://evil.example"})
        rebound = client.get("/v1/jobs", headers={"Host": "evil.example"})
        proxied = client.get("/v1/jobs", headers={"X-Forwarded-For": "203.0.113.5"})
    assert own.status_code == 200
    assert {foreign.status_code, rebound.status_code, proxied.status_code} == {403}
    assert rebound.json()["code"] == "forbidden_host"


@pytest.fixture
def limited(tmp_path: Path) -> Iterator[httpx.Client]:
    settings = make_settings(tmp_path, rate_limit_per_minute=5)
    with running_broker(settings), running_api(settings) as client:
        yield client


def test_too_many_calls_are_told_when_to_come_back(limited: httpx.Client) -> None:
    statuses = [limited.get("/v1/jobs").status_code for _ in range(11)]
    assert statuses.count(200) >= 5
    assert statuses[-1] == 429
    refused = limited.get("/v1/jobs")
    assert refused.json()["code"] == "rate_limited"
    assert 1 <= int(refused.headers["Retry-After"]) <= 60
