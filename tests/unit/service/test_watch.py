"""A folder that turns scans into meshes, across crashes of either side."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, running_api, sphere_scan

from service.client import Client, Job
from service.client.ledger import Ledger
from service.client.watch import CannotWatch, FolderWatch


class Crash(BaseException):
    """The process dies here."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "scans"
    made.mkdir()
    return made


@pytest.fixture
def client(api: httpx.Client) -> Iterator[Client]:
    with Client(str(api.base_url)) as opened:
        yield opened


def job_names(api: httpx.Client) -> list[str]:
    return sorted(job["scan"]["name"] for job in api.get("/v1/jobs").json()["jobs"])


def finish(monkeypatch: pytest.MonkeyPatch, client: Client, status: str) -> None:
    """Let every job look as if it had ended, with a mesh where it succeeded."""
    real: Callable[[str], Job] = client.get

    def get(job_id: str) -> Job:
        raw = {**real(job_id).raw, "status": status}
        mesh = {"name": "mesh.glb", "size": 4, "sha256": "", "content_type": ""}
        raw["artifacts"] = [mesh] if status == "succeeded" else []
        raw["error"] = {"code": "too_few_points", "detail": "Send more points."}
        return Job.of(raw)

    def download(job_id: str, name: str, target: Path) -> Path:
        target.write_text("mesh")
        return target

    monkeypatch.setattr(client, "get", get)
    monkeypatch.setattr(client, "download", download)


def test_every_scan_is_submitted_once_and_results_land_beside_it(
    api: httpx.Client, client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    (folder / "notes.md").write_text("not a scan")
    (folder / ".hidden.ply").write_bytes(sphere_scan())
    with FolderWatch(folder, client, {"resolution": 64}, settle=0) as watch:
        for _ in range(3):
            watch.look()
        assert job_names(api) == ["a.ply"]
        finish(monkeypatch, client, "succeeded")
        (folder / "b.ply").write_bytes(sphere_scan(201))
        for _ in range(3):
            watch.look()
    assert job_names(api) == ["a.ply", "b.ply"]
    assert {path.name for path in folder.glob("*.mesh.glb")} == {"a.mesh.glb", "b.mesh.glb"}


@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_crash_around_the_submission_does_not_submit_twice(
    api: httpx.Client, client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    real = client.submit

    def crash(*args: object, **params: object) -> Job:
        if moment == "after":
            real(*args, **params)  # type: ignore[arg-type]
        raise Crash

    monkeypatch.setattr(client, "submit", crash)
    with FolderWatch(folder, client, {}, settle=0) as watch, pytest.raises(Crash):
        watch.look()
    monkeypatch.setattr(client, "submit", real)
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
        watch.look()
    assert job_names(api) == ["a.ply"]


def test_a_submission_older_than_its_key_is_looked_up(
    api: httpx.Client, client: Client, folder: Path
) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
    ledger = Ledger(folder / ".visco-watch.db")
    ledger.put("a.ply", ledger.entries["a.ply"].evolve(state="submitting", key="x", begun_at=0.0))
    ledger.close()
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
    assert job_names(api) == ["a.ply"]


def test_a_file_that_is_still_written_is_left_alone(
    api: httpx.Client, client: Client, folder: Path
) -> None:
    scan = folder / "a.ply"
    with FolderWatch(folder, client, {}, settle=3600) as watch:
        scan.write_bytes(sphere_scan()[:100])
        watch.look()
        scan.write_bytes(sphere_scan())
        watch.look()
        assert job_names(api) == []
        watch.settle = 0
        watch.look()
    assert job_names(api) == ["a.ply"]


def test_a_touched_file_is_not_new_but_a_changed_one_is(
    api: httpx.Client, client: Client, folder: Path
) -> None:
    scan = folder / "a.ply"
    scan.write_bytes(sphere_scan())
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
        os.utime(scan)
        watch.look()
        assert job_names(api) == ["a.ply"]
        scan.write_bytes(sphere_scan(201))
        watch.look()
    assert job_names(api) == ["a.ply", "a.ply"]


def test_what_the_service_refuses_and_what_fails_is_reported_beside_the_scan(
    client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "bad.ply").write_bytes(b"hello")
    (folder / "thin.ply").write_bytes(sphere_scan())
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
        finish(monkeypatch, client, "failed")
        watch.look()
    assert (folder / "bad.error.txt").read_text().startswith("not_a_point_cloud: ")
    assert (folder / "thin.error.txt").read_text() == "too_few_points: Send more points.\n"


def test_parameters_that_the_service_refuses_end_the_watch_and_fail_no_scan(
    api: httpx.Client, client: Client, folder: Path
) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    refused = pytest.raises(CannotWatch, match=r"params\.resolution")
    with FolderWatch(folder, client, {"resolution": 1}, settle=0) as watch, refused:
        watch.look()
    assert not list(folder.glob("*.error.txt"))
    with FolderWatch(folder, client, {"resolution": 64}, settle=0) as watch:
        watch.look()
    assert job_names(api) == ["a.ply"]


def test_two_scans_of_one_stem_keep_their_results_apart(
    client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    (folder / "a.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n" * 5)
    finish(monkeypatch, client, "succeeded")
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
        watch.look()
    assert {p.name for p in folder.glob("*.mesh.glb")} == {"a.mesh.glb", "a.xyz.mesh.glb"}


def test_a_folder_is_watched_by_one_process(client: Client, folder: Path) -> None:
    first = FolderWatch(folder, client, {})
    with first, pytest.raises(CannotWatch), FolderWatch(folder, client, {}):
        pass


def test_a_service_that_is_away_is_waited_for(folder: Path, tmp_path: Path) -> None:
    (folder / "a.ply").write_bytes(sphere_scan())
    settings = make_settings(tmp_path)
    url = f"http://127.0.0.1:{settings.port}"
    with Client(url) as client, FolderWatch(folder, client, {}, settle=0) as watch:
        client._http.timeout = 1
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("service.client.flow._FIRST_PAUSE", 0.001)
            watch.look()
        with running_api(settings) as api:
            watch.look()
            assert job_names(api) == ["a.ply"]


def test_the_ledger_forgets_scans_that_are_gone(
    client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan = folder / "a.ply"
    scan.write_bytes(sphere_scan())
    finish(monkeypatch, client, "succeeded")
    with FolderWatch(folder, client, {}, settle=0) as watch:
        watch.look()
        watch.look()
        scan.unlink()
        watch.look()
        assert watch.ledger.entries == {}
