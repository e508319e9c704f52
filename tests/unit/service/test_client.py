"""The Python client against a running API, and against a network that fails."""

from __future__ import annotations

import asyncio
import hashlib
import inspect
import random
from pathlib import Path
from typing import Any

import httpx
import pytest
from servicekit import sphere_scan

import service.client as client_package
from service.client import (
    ApiError,
    AsyncClient,
    Client,
    ClientError,
    JobUnsuccessful,
    ServiceUnreachable,
)
from service.client import calls as client_calls
from service.client import flow as client_flow
from service.client.flow import pause_seconds
from service.client.sse import EventParser


@pytest.fixture(autouse=True)
def _no_long_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_flow, "_FIRST_PAUSE", 0.001)
    monkeypatch.setattr(client_flow, "_LONGEST_PAUSE", 0.01)


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "part.ply"
    path.write_bytes(sphere_scan(300))
    return path


class Flaky(httpx.BaseTransport):
    """Loses every ``losing``-th request, half of them only after the service has answered."""

    def __init__(self, losing: int) -> None:
        self.losing = losing
        self.count = 0
        self.inner = httpx.HTTPTransport()

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        self.count += 1
        lose = self.count % self.losing == 0
        if lose and self.count % (2 * self.losing) == 0:
            raise httpx.ConnectError("lost on the way", request=request)
        answer = self.inner.handle_request(request)
        if lose:
            answer.read()
            raise httpx.ReadError("lost on the way back", request=request)
        return answer

    def close(self) -> None:
        self.inner.close()


def flaky_client(api: httpx.Client, losing: int = 2) -> Client:
    client = Client(str(api.base_url))
    client._http.close()
    client._http = httpx.Client(base_url=api.base_url, transport=Flaky(losing))
    return client


def test_both_clients_have_the_same_calls() -> None:
    def public(kind: type) -> dict[str, list[str]]:
        methods = inspect.getmembers(kind, inspect.isfunction)
        return {n: list(inspect.signature(m).parameters) for n, m in methods if n[0] != "_"}

    assert public(Client) == public(AsyncClient)
    assert set(client_package.__all__) <= set(dir(client_package))


def test_a_submission_over_a_bad_network_makes_one_job(api: httpx.Client, scan: Path) -> None:
    with flaky_client(api) as client:
        for _ in range(3):
            client.submit(scan, resolution=64)
    assert len(api.get("/v1/jobs").json()["jobs"]) == 3


def test_a_large_scan_arrives_whole_over_a_bad_network(
    api: httpx.Client, scan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_calls, "_ONE_REQUEST_BYTES", 1000)
    monkeypatch.setattr(client_calls, "_PIECE_BYTES", 1500)
    seen: list[tuple[int, int]] = []
    with flaky_client(api) as client:
        job = client.submit(scan, on_upload=lambda *state: seen.append(state))
    assert job.raw["scan"]["sha256"] == hashlib.sha256(scan.read_bytes()).hexdigest()
    assert seen == sorted(seen)
    assert seen[-1] == (scan.stat().st_size, scan.stat().st_size)


def test_jobs_go_over_all_pages(api: httpx.Client, scan: Path) -> None:
    with Client(str(api.base_url)) as client:
        made = [client.submit(scan, label=str(number)).id for number in range(3)]
        assert [job.id for job in client.jobs(limit=2)] == made[::-1]
        client.cancel(made[0])
        assert [job.id for job in client.jobs(status="cancelled")] == made[:1]


def test_waiting_for_a_cancelled_job_raises_with_the_job(api: httpx.Client, scan: Path) -> None:
    with Client(str(api.base_url)) as client:
        job = client.submit(scan)
        client.cancel(job.id)
        with pytest.raises(JobUnsuccessful) as caught:
            client.wait(job.id)
        assert caught.value.job.status == "cancelled"
        assert [event.type for event in client.events(job.id)] == ["queued", "cancelled"]
        again = client.retry(job.id, resolution=64)
        assert again.raw["retry_of"] == job.id
        client.delete(job.id)
        with pytest.raises(ApiError, match="Check the id") as refused:
            client.get(job.id)
    assert (refused.value.status, refused.value.code) == (404, "job_not_found")


def test_the_asynchronous_client_does_the_same(api: httpx.Client, scan: Path) -> None:
    async def story() -> list[str]:
        async with AsyncClient(str(api.base_url)) as client:
            job = await client.submit(scan, resolution=64)
            await client.cancel(job.id)
            listed = [found.id async for found in client.jobs()]
            assert listed == [job.id]
            return [event.type async for event in client.events(job.id)]

    assert asyncio.run(story()) == ["queued", "cancelled"]


def test_a_service_that_is_not_there_is_told_after_some_tries() -> None:
    unreachable = pytest.raises(ServiceUnreachable, match=r"http://127.0.0.1:9 .* `visco serve`")
    with Client("http://127.0.0.1:9") as client, unreachable:
        client.get("x")


def test_a_long_pause_is_explained(caplog: pytest.LogCaptureFixture) -> None:
    problem = {"code": "quota_queued", "detail": "Wait until some jobs have started."}
    flow = client_flow.call(client_flow.Send("GET", "/"))
    flow.send(None)
    pause = flow.send(httpx.Response(429, headers={"Retry-After": "30"}, json=problem))
    assert pause == client_flow.Pause(30.0)
    assert caplog.messages == ["Wait until some jobs have started. Trying again in 30 s."]


@pytest.mark.parametrize("address", ["127.0.0.1:8000", "ftp://example.org", "here"])
def test_what_is_no_address_is_refused_at_once(address: str) -> None:
    with pytest.raises(ClientError, match="begins with http"):
        Client(address)


def test_pauses_grow_and_obey_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_flow, "_FIRST_PAUSE", 0.25)
    monkeypatch.setattr(client_flow, "_LONGEST_PAUSE", 8.0)
    random.seed(1)
    pauses = [pause_seconds(tried, None) for tried in range(1, 9)]
    assert pauses[0] <= 0.25
    assert 4 <= pauses[-1] <= 8
    assert pause_seconds(1, httpx.Response(429, headers={"Retry-After": "17"})) == 17


def test_wrong_params_are_not_tried_again(api: httpx.Client, scan: Path) -> None:
    with flaky_client(api, losing=10**6) as client, pytest.raises(ApiError) as caught:
        client.submit(scan, resolution=1)
    assert caught.value.code == "invalid_params"
    assert caught.value.errors[0]["path"] == "params.resolution"


def test_an_artifact_is_downloaded_across_cuts_and_checked(tmp_path: Path) -> None:
    content = bytes(range(256)) * 40
    job: dict[str, Any] = {
        "id": "j", "status": "succeeded", "label": None, "progress": None, "error": None,
        "artifacts": [{"name": "mesh.glb", "size": len(content), "content_type": "x",
                       "sha256": hashlib.sha256(content).hexdigest()}],
    }  # fmt: skip

    class Cutting(httpx.SyncByteStream):
        def __init__(self, data: bytes) -> None:
            self.data = data

        def __iter__(self):
            yield self.data[:3000]
            raise httpx.ReadError("cut")

    def serve(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/jobs/j"):
            return httpx.Response(200, json=job)
        start = int(request.headers.get("range", "bytes=0-")[6:-1])
        return httpx.Response(206 if start else 200, stream=Cutting(content[start:]))

    client = Client("http://test")
    client._http = httpx.Client(base_url="http://test", transport=httpx.MockTransport(serve))
    target = client.download("j", "mesh.glb", tmp_path / "out.glb")
    assert target.read_bytes() == content
    job["artifacts"][0]["sha256"] = "0" * 64
    with pytest.raises(client_package.ClientError, match="damaged"):
        client.download("j", "mesh.glb", tmp_path / "bad.glb")
    assert [path.name for path in tmp_path.iterdir()] == ["out.glb"]
    client.close()


def test_comments_and_events_without_id_are_passed_over() -> None:
    parser = EventParser()
    lines = [": ping", "", "retry: 5", "", "event: progress", 'data: {"a": 1}', "id: 7", ""]
    events = [event for line in lines if (event := parser.feed(line)) is not None]
    assert [(event.sequence, event.type, event.data) for event in events] == [
        (7, "progress", {"a": 1})
    ]
