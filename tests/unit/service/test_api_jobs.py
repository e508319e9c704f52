"""The calls about jobs, over a real socket."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from servicekit import make_settings, read_events, running_api, sphere_scan, submit, until

from service.settings import Settings
from visco_core.io import HEAD_BYTES


def test_a_submitted_job_is_where_location_says(api: httpx.Client) -> None:
    answer = submit(api, resolution=128, label="part 7", priority="high")
    job = api.get(answer.headers["Location"]).json()
    assert (job["id"], job["status"], job["label"]) == (answer.json()["id"], "queued", "part 7")
    assert job["params"] == {"resolution": 128, "label": "part 7", "priority": "high"}
    assert job["scan"]["points"] == 200


def test_the_queue_goes_by_priority_then_age(api: httpx.Client) -> None:
    names = [("a", "low"), ("b", "normal"), ("c", "high"), ("d", "normal")]
    ids = {name: submit(api, label=name, priority=p).json()["id"] for name, p in names}
    places = {name: api.get(f"/v1/jobs/{ids[name]}").json()["queue_position"] for name, _ in names}
    assert places == {"c": 1, "b": 2, "d": 3, "a": 4}
    listed = {job["label"]: job["queue_position"] for job in api.get("/v1/jobs").json()["jobs"]}
    assert listed == places


def test_pages_hold_every_job_once_newest_first(api: httpx.Client) -> None:
    ids = [submit(api).json()["id"] for _ in range(5)]
    seen, cursor = [], None
    while True:
        page = api.get("/v1/jobs", params={"limit": 2, **({"cursor": cursor} if cursor else {})})
        seen += [job["id"] for job in page.json()["jobs"]]
        cursor = page.json()["next_cursor"]
        if cursor is None:
            break
    assert seen == ids[::-1]


def test_filters_pick_by_status_label_and_text(api: httpx.Client) -> None:
    kept = submit(api, label="left_hand").json()["id"]
    gone = submit(api, label="right").json()["id"]
    api.post(f"/v1/jobs/{gone}/cancel")

    def ids(**query: object) -> list[str]:
        return [job["id"] for job in api.get("/v1/jobs", params=query).json()["jobs"]]  # type: ignore[arg-type]

    assert ids(status="queued") == [kept]
    assert ids(status=["queued", "cancelled"]) == [gone, kept]
    assert ids(label="right") == [gone]
    assert ids(q="T_H") == [kept]
    assert ids(q="%") == []
    assert ids(q="scan.p") == [gone, kept]


def test_an_invented_cursor_is_refused(api: httpx.Client) -> None:
    refused = api.get("/v1/jobs", params={"cursor": "'; drop"})
    assert (refused.status_code, refused.json()["code"]) == (400, "invalid_cursor")


def test_cancelling_twice_is_no_error_and_events_end(api: httpx.Client) -> None:
    job = submit(api).json()["id"]
    assert api.post(f"/v1/jobs/{job}/cancel").json()["status"] == "cancelled"
    assert api.post(f"/v1/jobs/{job}/cancel").status_code == 202
    assert [event["event"] for event in read_events(api, job)] == ["queued", "cancelled"]


def test_events_go_on_after_the_last_one_seen(api: httpx.Client) -> None:
    job = submit(api).json()["id"]
    first = read_events(api, job, until="queued")
    api.post(f"/v1/jobs/{job}/cancel")
    rest = read_events(api, job, after=int(first[-1]["id"]))
    assert [event["id"] for event in first + rest] == ["1", "2"]
    done = api.get(f"/v1/jobs/{job}/events", headers={"Last-Event-ID": "2"})
    assert (done.status_code, done.content) == (204, b"")


def test_a_retry_is_a_new_job_of_the_same_scan_with_changed_params(api: httpx.Client) -> None:
    job = submit(api, resolution=64, label="a").json()
    early = api.post(f"/v1/jobs/{job['id']}/retry")
    assert (early.status_code, early.json()["code"]) == (409, "job_not_finished")
    api.post(f"/v1/jobs/{job['id']}/cancel")
    again = api.post(f"/v1/jobs/{job['id']}/retry", json={"resolution": 128}).json()
    assert again["id"] != job["id"]
    assert again["params"] == {"resolution": 128, "label": "a"}
    assert (again["retry_of"], again["scan"]) == (job["id"], job["scan"])


@pytest.mark.parametrize(
    ("params", "path"), [('{"resolution": 1}', "params.resolution"), ('{"no": 1}', "params.no")]
)
def test_a_retry_refuses_wrong_params_as_a_submission_does(
    api: httpx.Client, params: str, path: str
) -> None:
    job = submit(api).json()
    api.post(f"/v1/jobs/{job['id']}/cancel")
    headers = {"Content-Type": "application/json"}
    answers = [
        api.post("/v1/jobs", files={"file": sphere_scan()}, data={"params": params}),
        api.post(f"/v1/jobs/{job['id']}/retry", content=params, headers=headers),
    ]
    first, second = [answer.json() | {"request_id": ""} for answer in answers]
    assert first == second
    assert (first["code"], first["errors"][0]["path"]) == ("invalid_params", path)


def test_delete_removes_the_bytes_once_no_job_needs_them(
    api: httpx.Client, settings: Settings
) -> None:
    job = submit(api).json()["id"]
    api.post(f"/v1/jobs/{job}/cancel")
    again = api.post(f"/v1/jobs/{job}/retry").json()["id"]
    storage = settings.data_dir / "storage"
    assert api.delete(f"/v1/jobs/{job}").status_code == 204
    assert [path for path in storage.rglob("*") if path.is_file()]
    assert api.delete(f"/v1/jobs/{again}").status_code == 204
    assert not [path for path in storage.rglob("*") if path.is_file()]
    assert api.get(f"/v1/jobs/{job}").json()["code"] == "job_not_found"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cat.png", b"\x89PNG\r\n\x1a\n" + bytes(500)),
        ("scan.ply", b"hello"),
        ("scan.ply", b""),
        ("scan.ply", sphere_scan()[:2000]),
        ("lies.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n"
                     b"property float x\nproperty float y\nproperty float z\nend_header\n"),
    ],
)  # fmt: skip
def test_what_is_no_scan_is_refused_and_leaves_nothing(
    api: httpx.Client, settings: Settings, name: str, content: bytes
) -> None:
    refused = api.post("/v1/jobs", files={"file": (name, content)})
    assert refused.json()["code"] in ("not_a_point_cloud", "too_many_points")
    assert refused.status_code in (415, 413)
    assert not [path for path in settings.data_dir.rglob("storage/**/*") if path.is_file()]
    assert not list((settings.data_dir / "tmp").iterdir())


def test_a_large_file_that_is_no_scan_is_refused_before_it_has_arrived(
    api: httpx.Client, settings: Settings
) -> None:
    part = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.ply"\r\n\r\n'
    head = (
        f"POST /v1/jobs HTTP/1.1\r\nHost: 127.0.0.1:{settings.port}\r\n"
        f"Content-Type: multipart/form-data; boundary=b\r\nContent-Length: {1 << 30}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", settings.port), timeout=20) as connection:
        connection.sendall(head.encode() + part + b"\x89PNG\r\n\x1a\n" + bytes(2 << 20))
        answer = connection.recv(1 << 16)
    assert answer.startswith(b"HTTP/1.1 415")


def binary_stl(triangles: int) -> bytes:
    """A binary STL: its length is all that shows what it is."""
    corners = np.random.default_rng(0).normal(size=(triangles, 3, 3)).astype("<f4")
    rows = np.zeros(
        triangles, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    )
    rows["corners"] = corners
    return bytes(80) + np.uint32(triangles).tobytes() + rows.tobytes()


@pytest.mark.parametrize("name", ["part.stl", "part"])
@pytest.mark.parametrize("chunked", [False, True])
def test_a_large_file_is_not_judged_by_the_length_of_the_body_around_it(
    api: httpx.Client, name: str, chunked: bool
) -> None:
    content = binary_stl(2 * HEAD_BYTES // 50)
    files = {"file": (name, content), "params": (None, '{"label": "after the file"}')}
    whole = httpx.Request("POST", "http://x/v1/jobs", files=files)
    body = iter([whole.read()]) if chunked else whole.read()
    headers = {"Content-Type": whole.headers["Content-Type"]}
    taken = api.post("/v1/jobs", content=body, headers=headers)
    assert taken.status_code == 202, taken.text


@pytest.mark.parametrize("chunked", [False, True])
def test_a_sound_scan_that_is_too_large_is_not_called_truncated(
    tmp_path: Path, chunked: bool
) -> None:
    whole = httpx.Request("POST", "http://x/v1/jobs", files={"file": ("s.ply", sphere_scan(9000))})
    body = iter([whole.read()]) if chunked else whole.read()
    headers = {"Content-Type": whole.headers["Content-Type"]}
    with running_api(make_settings(tmp_path, max_upload_bytes=HEAD_BYTES + 5000)) as client:
        refused = client.post("/v1/jobs", content=body, headers=headers)
    assert (refused.status_code, refused.json()["code"]) == (413, "too_large")


@pytest.fixture
def small(tmp_path: Path) -> Iterator[httpx.Client]:
    with running_api(make_settings(tmp_path, max_upload_bytes=5000, max_points=150)) as client:
        yield client


def test_a_file_above_the_limit_is_refused_also_when_it_is_chunked(small: httpx.Client) -> None:
    assert len(sphere_scan()) > 5000
    assert submit(small).json()["code"] == "too_large"
    whole = httpx.Request("POST", "http://x/v1/jobs", files={"file": ("scan.ply", sphere_scan())})
    chunks = iter([whole.read()])
    headers = {"Content-Type": whole.headers["Content-Type"]}
    refused = small.post("/v1/jobs", content=chunks, headers=headers)
    assert (refused.status_code, refused.json()["code"]) == (413, "too_large")


def test_a_small_call_takes_no_large_body(api: httpx.Client) -> None:
    large = b"{" + b" " * (2 << 20) + b"}"
    headers = {"Content-Type": "application/json"}
    for body in (large, iter([large])):
        refused = api.post("/v1/jobs/x/retry", content=body, headers=headers)
        assert (refused.status_code, refused.json()["code"]) == (413, "too_large")
        assert refused.headers["content-type"] == "application/problem+json"


def test_a_header_that_declares_too_many_points_is_refused(small: httpx.Client) -> None:
    declared = b"ply\nformat ascii 1.0\nelement vertex 151\nproperty float x\nproperty float y\n"
    rows = b"property float z\nend_header\n" + b"1 2 3\n" * 151
    refused = small.post("/v1/jobs", files={"file": ("scan.ply", declared + rows)})
    assert (refused.status_code, refused.json()["code"]) == (413, "too_many_points")


def test_a_broken_submission_says_what_is_missing(api: httpx.Client) -> None:
    scan = ("scan.ply", sphere_scan())
    answers = {
        "no body": api.post("/v1/jobs"),
        "json": api.post("/v1/jobs", json={}),
        "nothing": api.post("/v1/jobs", files={"params": (None, "{}")}),
        "both": api.post("/v1/jobs", files={"file": scan}, data={"upload_id": "x"}),
        "unknown field": api.post("/v1/jobs", files={"file": scan, "other": (None, "1")}),
        "cut off": api.post(
            "/v1/jobs",
            content=b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nply\n',
            headers={"Content-Type": "multipart/form-data; boundary=b"},
        ),
        "file and empty upload": api.post("/v1/jobs", files={"file": scan}, data={"upload_id": ""}),
        "unknown upload": api.post("/v1/jobs", files={"upload_id": (None, "x")}),
    }
    codes = {case: (answer.status_code, answer.json()["code"]) for case, answer in answers.items()}
    assert codes == {
        "no body": (415, "unsupported_media_type"),
        "json": (415, "unsupported_media_type"),
        "nothing": (422, "invalid_request"),
        "file and empty upload": (422, "invalid_request"),
        "both": (422, "invalid_request"),
        "unknown field": (422, "invalid_request"),
        "cut off": (400, "bad_request"),
        "unknown upload": (404, "upload_not_found"),
    }


def test_options_describe_every_parameter_of_the_schema(api: httpx.Client) -> None:
    options = {option["name"]: option for option in api.get("/v1/options").json()["options"]}
    schema = api.get("/openapi.json").json()["components"]["schemas"]["JobParams"]
    assert set(options) == set(schema["properties"])
    resolution = options["resolution"]
    assert (resolution["minimum"], resolution["maximum"]) == (64, 1024)
    assert resolution["default"] == 256
    assert all(option["help"] for option in options.values())


def test_file_names_lose_their_folders_and_control_characters(api: httpx.Client) -> None:
    names = {"../../etc/passwd.ply": "passwd.ply", "C:\\scans\\a.ply": "a.ply", "..": "scan"}
    for given, kept in names.items():
        answer = api.post("/v1/jobs", files={"file": (given, sphere_scan())})
        assert answer.json()["scan"]["name"] == kept


def test_the_log_tells_what_changes_something_or_is_refused(
    api: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "service.access")
    job_id = submit(api).json()["id"]
    api.get(f"/v1/jobs/{job_id}")
    api.get("/v1/jobs/nope")

    def told() -> list[str]:
        lines = [record.getMessage().rsplit(" in ", 1)[0] for record in caplog.records]
        return [line for line in lines if "/v1/" in line]

    # A line is written after its answer has been sent.
    until(lambda: len(told()) == 2)
    assert told() == ["POST /v1/jobs 202", "GET /v1/jobs/nope 404"]


def test_every_answer_carries_the_request_id(api: httpx.Client) -> None:
    assert api.get("/healthz", headers={"X-Request-ID": "abc-1"}).headers["X-Request-ID"] == "abc-1"
    refused = api.get("/v1/jobs/nope", headers={"X-Request-ID": "bad\tid"})
    assert refused.headers["X-Request-ID"] == json.loads(refused.text)["request_id"]
    assert len(refused.json()["request_id"]) == 26
