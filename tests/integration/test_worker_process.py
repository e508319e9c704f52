"""Jobs through a real broker, a real worker process and the real solver."""

from __future__ import annotations

import hashlib
import os
import signal
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, read_events, running_api, running_broker, sphere_scan, submit
from workerkit import ENDLESS, Service, Worker

from service.settings import Settings

SCAN = sphere_scan(2000)


def test_a_scan_becomes_a_mesh_with_every_artifact(service: Service, worker: Worker) -> None:
    job_id = submit(service.api, SCAN, resolution=128).json()["id"]
    events = read_events(service.api, job_id)
    job = service.job(job_id)
    assert job["status"] == "succeeded", job["error"]
    assert [int(event["id"]) for event in events] == list(range(1, len(events) + 1))
    levels = [event["data"]["resolution"] for event in events if event["event"] == "level"]
    assert levels == sorted(levels)
    assert levels
    fractions = [e["data"]["fraction"] for e in events if e["event"] == "progress"]
    assert fractions == sorted(fractions)
    assert job["result"]["outcome"]["resolution"] == 128
    assert job["attempts"][0]["worker"] == worker.name
    check_artifacts(service.api, job_id)
    again = submit(service.api, SCAN, resolution=64, outputs=["mesh.ply"]).json()["id"]
    assert read_events(service.api, again)[-1]["event"] == "succeeded"


def check_artifacts(api: httpx.Client, job_id: str) -> None:
    listed = api.get(f"/v1/jobs/{job_id}/artifacts").json()["artifacts"]
    contents = {}
    for artifact in listed:
        answer = api.get(artifact["url"])
        assert answer.headers["content-type"].split(";")[0] == artifact["content_type"]
        assert hashlib.sha256(answer.content).hexdigest() == artifact["sha256"]
        assert answer.headers["etag"] == f'"{artifact["sha256"]}"'
        contents[artifact["name"]] = answer.content
    assert {"mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt"} <= set(contents)
    assert contents["mesh.glb"].startswith(b"glTF")
    assert contents["mesh.ply"].startswith(b"ply")
    assert contents["preview.png"].startswith(b"\x89PNG")
    check_conditions(api, f"/v1/jobs/{job_id}/artifacts/mesh.glb", contents["mesh.glb"])


def check_conditions(api: httpx.Client, url: str, content: bytes) -> None:
    etag = api.head(url).headers["etag"]
    for given in (etag, f"W/{etag}", f'"x", {etag}', "*"):
        unchanged = api.get(url, headers={"If-None-Match": given})
        assert (unchanged.status_code, unchanged.content) == (304, b"")
    assert api.get(url, headers={"If-None-Match": '"x"'}).status_code == 200
    size = len(content)
    for given, start, end in (
        ("bytes=0-3", 0, 4),
        ("bytes=100-", 100, size),
        ("bytes=-10", size - 10, size),
        (f"bytes={size - 1}-{size + 50}", size - 1, size),
    ):
        part = api.get(url, headers={"Range": given})
        assert (part.status_code, part.content) == (206, content[start:end])
        assert part.headers["content-range"] == f"bytes {start}-{end - 1}/{size}"
    beyond = api.get(url, headers={"Range": f"bytes={size}-"})
    assert (beyond.status_code, beyond.json()["code"]) == (416, "range_not_satisfiable")
    assert beyond.headers["content-range"] == f"bytes */{size}"
    changed = api.get(url, headers={"Range": "bytes=0-3", "If-Range": '"old"'})
    assert (changed.status_code, len(changed.content)) == (200, size)


def test_a_running_solve_is_cancelled_and_the_worker_takes_the_next(
    service: Service, worker: Worker
) -> None:
    job_id = service.start_endless()
    service.cancel(job_id)
    following = submit(service.api, SCAN, resolution=64, outputs=["mesh.ply"]).json()["id"]
    assert read_events(service.api, following)[-1]["event"] == "succeeded"


def test_a_waiting_job_is_taken_by_whichever_worker_is_free(
    service: Service, worker: Worker
) -> None:
    first = service.start_endless()
    second = submit(service.api, SCAN, **ENDLESS).json()["id"]
    with service.worker() as other:
        service.wait_for_solving(second)
        taken = [service.job(job_id)["attempts"][0]["worker"] for job_id in (first, second)]
        assert taken == [worker.name, other.name]
        for job_id in (first, second):
            service.cancel(job_id)


def test_an_urgent_job_overtakes_those_that_wait(service: Service, worker: Worker) -> None:
    solving = service.start_endless()
    names = [("low", "low"), ("normal", "normal"), ("high", "high")]
    small = {"resolution": 64, "outputs": ["mesh.ply"]}
    ids = [submit(service.api, SCAN, label=n, priority=p, **small).json()["id"] for n, p in names]
    service.cancel(solving)
    for job_id in ids:
        assert read_events(service.api, job_id)[-1]["event"] == "succeeded"
    started = {service.job(job_id)["started_at"]: service.job(job_id)["label"] for job_id in ids}
    assert [started[moment] for moment in sorted(started)] == ["high", "normal", "low"]


@pytest.fixture
def patient(tmp_path: Path) -> Settings:
    """Leases that outlive the test: whoever waits for one to run out waits in vain."""
    return make_settings(tmp_path, lease_seconds=3600.0)


def test_a_killed_solve_runs_again_at_once_and_finally_fails(patient: Settings) -> None:
    with running_broker(patient), running_api(patient) as client:
        service = Service(patient, client)
        with service.worker() as worker:
            job_id = service.start_endless()
            for attempt in (1, 2, 3):
                service.wait_for_solving(job_id, attempt)
                os.kill(worker.child(), signal.SIGKILL)
            types = [event["event"] for event in read_events(client, job_id)]
            assert service.job(job_id)["error"]["code"] == "worker_lost"
    assert [t for t in types if t not in ("progress", "level", "scan", "artifact")] == [
        "queued", "started", "requeued", "started", "requeued", "started", "failed",
    ]  # fmt: skip


def test_the_job_of_a_lost_machine_is_finished_by_another_worker_once(
    service: Service, worker: Worker
) -> None:
    job_id = service.start_endless(budget_seconds=30, outputs=["mesh.ply"])
    with service.worker() as other:
        worker.kill()
        service.wait_for_solving(job_id, attempt=2)
        job = service.job(job_id)
        assert [a["worker"] for a in job["attempts"]] == [worker.name, other.name]
        assert job["attempts"][0]["outcome"] == "lost"
        service.cancel(job_id)


def test_a_worker_that_is_told_to_end_gives_its_job_to_another(
    service: Service, worker: Worker
) -> None:
    job_id = service.start_endless()
    with service.worker():
        assert worker.terminate() == 0
        service.wait_for_solving(job_id, attempt=2)
        job = service.job(job_id)
        assert job["attempts"][0]["outcome"] == "released"
        service.cancel(job_id)


def test_jobs_submitted_while_the_broker_is_away_run_when_it_is_back(settings: Settings) -> None:
    with running_api(settings) as client:
        service = Service(settings, client)
        job_id = submit(client, SCAN, resolution=64, outputs=["mesh.ply"]).json()["id"]
        assert service.job(job_id)["status"] == "queued"
        with running_broker(settings), service.worker():
            assert read_events(client, job_id)[-1]["event"] == "succeeded"


def test_a_broker_that_is_killed_in_mid_solve_loses_nothing(settings: Settings) -> None:
    with running_api(settings) as client:
        service = Service(settings, client)
        with running_broker(settings) as broker, service.worker():
            solving = service.start_endless()
            broker.kill()
            broker.wait()
            waiting = submit(client, SCAN, resolution=64, outputs=["mesh.ply"]).json()["id"]
            with running_broker(settings):
                service.cancel(solving)
                assert read_events(client, waiting)[-1]["event"] == "succeeded"
            assert len(service.job(solving)["attempts"]) == 1


def test_a_second_api_process_sees_and_follows_every_job(service: Service, worker: Worker) -> None:
    second = Settings(**{**service.settings.model_dump(), "port": make_settings(Path("/")).port})
    job_id = submit(service.api, SCAN, resolution=64).json()["id"]
    with running_api(second) as other:
        assert read_events(other, job_id) == read_events(service.api, job_id)


@pytest.fixture
def impatient(tmp_path: Path) -> Settings:
    return make_settings(tmp_path, hard_limit_seconds=2.0, lease_seconds=4.0)


def test_a_solve_past_its_hard_limit_fails_and_the_worker_lives_on(impatient: Settings) -> None:
    with running_broker(impatient), running_api(impatient) as client:
        service = Service(impatient, client)
        with service.worker():
            hung = submit(client, SCAN, **ENDLESS).json()["id"]
            assert read_events(client, hung)[-1]["event"] == "failed"
            assert service.job(hung)["error"]["code"] == "hard_limit"
            bounded = {"resolution": 64, "budget_seconds": 30, "outputs": ["mesh.ply"]}
            following = submit(client, SCAN, **bounded).json()["id"]
            assert read_events(client, following)[-1]["event"] == "succeeded"
