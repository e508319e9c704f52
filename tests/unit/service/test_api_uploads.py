"""Resumable uploads."""

from __future__ import annotations

import base64
import hashlib
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, running_api, sphere_scan, until
from sqlalchemy import update

from service.db import Database, utc_now
from service.jobs.sweeper import Sweeper
from service.settings import Settings
from service.storage import open_storage
from service.uploads.model import Upload
from visco_core.io import HEAD_BYTES

SCAN = sphere_scan(300)
PIECE = {"Content-Type": "application/offset+octet-stream", "Tus-Resumable": "1.0.0"}


def create(api: httpx.Client, size: int = len(SCAN), name: str = "scan.ply") -> str:
    metadata = f"filename {base64.b64encode(name.encode()).decode()}"
    headers = {"Upload-Length": str(size), "Upload-Metadata": metadata, "Tus-Resumable": "1.0.0"}
    answer = api.post("/v1/uploads", headers=headers)
    assert answer.status_code == 201, answer.text
    return answer.headers["Location"]


def send(api: httpx.Client, place: str, offset: int, data: bytes, **more: str) -> httpx.Response:
    headers = {**PIECE, "Upload-Offset": str(offset), **more}
    return api.patch(place, content=data, headers=headers)


def test_a_scan_sent_in_pieces_becomes_a_job(api: httpx.Client, settings: Settings) -> None:
    place = create(api)
    assert send(api, place, 0, SCAN[:1000]).headers["Upload-Offset"] == "1000"
    head = api.head(place)
    assert (head.status_code, head.headers["Upload-Offset"]) == (200, "1000")
    assert head.headers["Cache-Control"] == "no-store"
    assert send(api, place, 1000, SCAN[1000:]).headers["Upload-Offset"] == str(len(SCAN))
    state = api.get(place).json()
    assert (state["complete"], state["points"], state["error"]) == (True, 300, None)
    job = api.post("/v1/jobs", files={"upload_id": (None, state["id"])}).json()
    assert job["scan"]["sha256"] == hashlib.sha256(SCAN).hexdigest()
    stored = [path for path in (settings.data_dir / "storage").rglob("*") if path.is_file()]
    assert [path.read_bytes() for path in stored] == [SCAN]


def test_a_piece_at_another_offset_is_refused_with_the_right_one(api: httpx.Client) -> None:
    place = create(api)
    send(api, place, 0, SCAN[:10])
    refused = send(api, place, 5, SCAN[5:])
    assert (refused.status_code, refused.json()["code"]) == (409, "offset_mismatch")
    assert refused.headers["Upload-Offset"] == "10"


def test_of_many_equal_pieces_at_once_one_is_kept(api: httpx.Client) -> None:
    place = create(api)
    with ThreadPoolExecutor(5) as pool:
        answers = list(pool.map(lambda _: send(api, place, 0, SCAN[:500]), range(5)))
    assert sorted(answer.status_code for answer in answers) == [204, 409, 409, 409, 409]
    send(api, place, 500, SCAN[500:])
    assert api.get(place).json()["complete"]


def test_what_arrived_before_a_cut_is_kept(api: httpx.Client, settings: Settings) -> None:
    data = SCAN + bytes(4 << 20)
    place = create(api, size=len(data))
    head = (
        f"PATCH {httpx.URL(place).path} HTTP/1.1\r\nHost: 127.0.0.1:{settings.port}\r\n"
        f"Content-Type: application/offset+octet-stream\r\nUpload-Offset: 0\r\n"
        f"Content-Length: {len(data)}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", settings.port), timeout=20) as connection:
        connection.sendall(head.encode() + data[: 3 << 20])
        until(lambda: any(f.stat().st_size for f in (settings.data_dir / "tmp").iterdir()))
    until(lambda: int(api.head(place).headers["Upload-Offset"]) > 0)
    offset = int(api.head(place).headers["Upload-Offset"])
    assert 1 << 20 <= offset <= 3 << 20
    assert send(api, place, offset, data[offset:]).headers["Upload-Offset"] == str(len(data))
    stored = [path for path in (settings.data_dir / "storage").rglob("*") if path.is_file()]
    assert [path.read_bytes() for path in stored] == [data]


def test_a_piece_with_a_wrong_checksum_is_refused_and_forgotten(api: httpx.Client) -> None:
    place = create(api)
    digest = base64.b64encode(hashlib.sha256(SCAN[:100]).digest()).decode()
    wrong = send(api, place, 0, SCAN[1:101], **{"Upload-Checksum": f"sha256 {digest}"})
    assert (wrong.status_code, wrong.json()["code"]) == (460, "checksum_mismatch")
    assert api.head(place).headers["Upload-Offset"] == "0"
    right = send(api, place, 0, SCAN[:100], **{"Upload-Checksum": f"sha256 {digest}"})
    assert right.status_code == 204
    unknown = send(api, place, 100, b"x", **{"Upload-Checksum": "crc32 AAAA"})
    assert unknown.status_code == 400


@pytest.mark.parametrize(
    ("metadata", "name"),
    [
        (
            f"other //8=,filename {base64.b64encode('Teil ü.ply'.encode()).decode()},flag",
            "Teil ü.ply",
        ),
        ("filename //8=", "\ufffd\ufffd"),
        ("flag", "scan"),
        ("", "scan"),
    ],
)
def test_of_the_metadata_the_file_name_is_taken(
    api: httpx.Client, metadata: str, name: str
) -> None:
    headers = {"Upload-Length": "5", "Upload-Metadata": metadata}
    assert api.post("/v1/uploads", headers=headers).json()["name"] == name


@pytest.mark.parametrize("metadata", ["filename a", "filename YWE", ",", "a  b", b"\xc2\x84"])
def test_metadata_that_are_none_are_refused(api: httpx.Client, metadata: str | bytes) -> None:
    headers = {"Upload-Length": "5", "Upload-Metadata": metadata}
    refused = api.post("/v1/uploads", headers=headers)  # type: ignore[arg-type]
    assert (refused.status_code, refused.json()["code"]) == (400, "bad_request")


def test_more_bytes_than_promised_are_refused(api: httpx.Client) -> None:
    place = create(api, size=10)
    assert send(api, place, 0, b"x" * 11).json()["code"] == "too_large"


def test_a_large_upload_that_is_no_scan_is_refused_with_its_first_piece(api: httpx.Client) -> None:
    place = create(api, size=1 << 30)
    refused = send(api, place, 0, b"\x89PNG\r\n\x1a\n" + bytes(1 << 20))
    assert (refused.status_code, refused.json()["code"]) == (415, "not_a_point_cloud")
    assert api.head(place).headers["Upload-Offset"] == "0"


def test_a_large_upload_of_another_length_than_its_header_says_is_refused_early(
    api: httpx.Client,
) -> None:
    scan = sphere_scan(6000)
    assert len(scan) > HEAD_BYTES
    header = scan.replace(b"vertex 6000", b"vertex 6000000")
    refused = send(api, create(api, size=len(header)), 0, header[: HEAD_BYTES + 1])
    assert (refused.status_code, refused.json()["code"]) == (415, "not_a_point_cloud")
    assert send(api, create(api, len(scan)), 0, scan[: HEAD_BYTES + 1]).status_code == 204


def test_a_complete_upload_that_is_no_scan_says_so_when_it_is_used(api: httpx.Client) -> None:
    place = create(api, size=5)
    assert send(api, place, 0, b"hello").status_code == 204
    state = api.get(place).json()
    assert state["error"]["code"] == "not_a_point_cloud"
    refused = api.post("/v1/jobs", files={"upload_id": (None, state["id"])})
    assert (refused.status_code, refused.json()["code"]) == (415, "not_a_point_cloud")


def test_an_unfinished_upload_cannot_be_used(api: httpx.Client) -> None:
    place = create(api)
    refused = api.post("/v1/jobs", files={"upload_id": (None, place.rsplit("/", 1)[1])})
    assert (refused.status_code, refused.json()["code"]) == (409, "upload_incomplete")


def test_an_upload_expires_and_is_swept_away(
    api: httpx.Client, database: Database, settings: Settings
) -> None:
    place = create(api)
    send(api, place, 0, SCAN[:10])
    with database.transaction() as unit:
        unit.session.execute(update(Upload).values(expires_at=utc_now()))
    gone = api.head(place)
    assert gone.status_code == 410
    assert Sweeper(database, open_storage(settings), settings).sweep_uploads() == 1
    assert api.head(place).status_code == 404
    assert not [path for path in (settings.data_dir / "storage").rglob("*") if path.is_file()]


def test_a_deleted_upload_is_gone(api: httpx.Client, settings: Settings) -> None:
    place = create(api)
    send(api, place, 0, SCAN[:10])
    assert api.delete(place).status_code == 204
    assert api.get(place).json()["code"] == "upload_not_found"
    assert not [path for path in (settings.data_dir / "storage").rglob("*") if path.is_file()]


def test_the_protocol_and_its_limits_are_told(api: httpx.Client, settings: Settings) -> None:
    told = api.options("/v1/uploads").headers
    assert told["Tus-Version"] == "1.0.0"
    assert told["Tus-Max-Size"] == str(settings.max_upload_bytes)
    assert {"creation", "checksum", "expiration", "termination"} <= set(
        told["Tus-Extension"].split(",")
    )


@pytest.mark.parametrize(
    ("headers", "status", "code"),
    [
        ({}, 422, "invalid_request"),
        ({"Upload-Length": "-1"}, 400, "bad_request"),
        ({"Upload-Length": "9" * 30}, 400, "bad_request"),
        ({"Upload-Length": "99999999999"}, 413, "too_large"),
        ({"Upload-Length": "5", "Upload-Metadata": "filename ***"}, 400, "bad_request"),
        ({"Upload-Length": "5", "Tus-Resumable": "0.2.2"}, 412, "tus_version"),
    ],
)
def test_a_wrong_creation_is_refused(
    api: httpx.Client, headers: dict[str, str], status: int, code: str
) -> None:
    refused = api.post("/v1/uploads", headers=headers)
    assert (refused.status_code, refused.json()["code"]) == (status, code)


def test_an_owners_quota_of_bytes_is_kept(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path, quota_bytes=len(SCAN) + 10)) as client:
        create(client)
        refused = client.post("/v1/uploads", headers={"Upload-Length": str(len(SCAN))})
    assert (refused.status_code, refused.json()["code"]) == (507, "quota_storage")


def test_a_full_disk_is_refused_with_507(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path, storage_reserve_bytes=1 << 60)) as client:
        refused = client.post("/v1/uploads", headers={"Upload-Length": "10"})
        direct = client.post("/v1/jobs", files={"file": ("scan.ply", SCAN)})
    assert (refused.status_code, refused.json()["code"]) == (507, "storage_full")
    assert direct.json()["code"] == "storage_full"
