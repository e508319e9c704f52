"""The standard tus client completes an upload after a cut."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from servicekit import make_settings, running_api, sphere_scan
from tusclient.client import TusClient
from tusclient.uploader import Uploader


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "part.ply"
    path.write_bytes(sphere_scan(3000))
    return path


def test_a_cut_upload_is_completed_by_another_run_of_the_client(tmp_path: Path, scan: Path) -> None:
    size = scan.stat().st_size
    with running_api(make_settings(tmp_path)) as api, scan.open("rb") as stream:

        def uploader(url: str | None = None) -> Uploader:
            client = TusClient(f"{api.base_url}/v1/uploads")
            return client.uploader(
                file_stream=stream, chunk_size=50_000, url=url, metadata={"filename": scan.name},
                upload_checksum=True,
            )  # fmt: skip

        first = uploader()
        first.upload(stop_at=100_000)
        assert first.url is not None
        assert 0 < first.offset < size
        second = uploader(first.url)
        assert second.offset == first.offset
        second.upload()
        upload_id = first.url.rsplit("/", 1)[1]
        job = api.post("/v1/jobs", files={"upload_id": (None, upload_id)}).json()
    assert job["scan"]["name"] == "part.ply"
    assert job["scan"]["sha256"] == hashlib.sha256(scan.read_bytes()).hexdigest()
