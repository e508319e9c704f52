"""Every call of the client as a flow."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import httpx

from service.client.errors import DamagedDownload, JobUnsuccessful, WaitTimeout
from service.client.flow import (
    Flow,
    Pause,
    Save,
    Send,
    call,
    may_pass,
    new_key,
    pause_seconds,
    raise_for,
)
from service.client.options import STALLS
from service.client.records import Artifact, Job

UploadCallback = Callable[[int, int], None]
JobCallback = Callable[[Job], None]

# Below this a scan goes with the job in one request; above, in pieces that survive a cut.
_ONE_REQUEST_BYTES = 8 << 20
_PIECE_BYTES = 8 << 20
_TUS = {"Tus-Resumable": "1.0.0"}


def submit(
    scan: Path, params: Mapping[str, Any], key: str | None, on_upload: UploadCallback | None
) -> Flow[Job]:
    size = scan.stat().st_size
    headers = {"Idempotency-Key": key or new_key()}
    fields: dict[str, Any] = {"params": (None, json.dumps(dict(params)))}
    if size <= _ONE_REQUEST_BYTES:
        fields["file"] = (scan.name, scan.read_bytes())
    else:
        upload_id = yield from upload(scan, on_upload)
        fields["upload_id"] = (None, upload_id)
    reply = yield from call(Send("POST", "/v1/jobs", headers, {"files": fields}))
    if on_upload is not None:
        on_upload(size, size)
    return Job.of(reply.json())


def upload(scan: Path, on_upload: UploadCallback | None) -> Flow[str]:
    """Send a file in pieces; after a cut it goes on where the service stands."""
    size = scan.stat().st_size
    name = base64.b64encode(scan.name.encode()).decode()
    headers = {**_TUS, "Upload-Length": str(size), "Upload-Metadata": f"filename {name}"}
    reply = yield from call(Send("POST", "/v1/uploads", headers))
    upload_id: str = reply.json()["id"]
    offset, stalls = 0, 0
    with scan.open("rb") as file:
        while offset < size:
            file.seek(offset)
            piece = file.read(_PIECE_BYTES)
            sent = yield _piece(upload_id, offset, piece)
            if isinstance(sent, httpx.Response) and sent.is_success:
                offset, stalls = int(sent.headers["Upload-Offset"]), 0
            else:
                stalls += 1
                lost_place = isinstance(sent, httpx.Response) and sent.status_code in (409, 460)
                if stalls == STALLS or not (lost_place or may_pass(sent)):
                    raise_for(sent)
                yield Pause(pause_seconds(stalls, sent))
                head = yield from call(Send("HEAD", f"/v1/uploads/{upload_id}", _TUS))
                arrived = int(head.headers["Upload-Offset"])
                # Only the answer was lost where the service has more than before.
                stalls = 0 if arrived > offset else stalls
                offset = arrived
            if on_upload is not None:
                on_upload(offset, size)
    return upload_id


def _piece(upload_id: str, offset: int, piece: bytes) -> Send:
    digest = base64.b64encode(hashlib.sha256(piece).digest()).decode()
    headers = {
        **_TUS,
        "Upload-Offset": str(offset),
        "Upload-Checksum": f"sha256 {digest}",
        "Content-Type": "application/offset+octet-stream",
    }
    return Send("PATCH", f"/v1/uploads/{upload_id}", headers, {"content": piece})


def get(job_id: str) -> Flow[Job]:
    reply = yield from call(Send("GET", f"/v1/jobs/{job_id}"))
    return Job.of(reply.json())


def page(query: Mapping[str, Any]) -> Flow[tuple[list[Job], str | None]]:
    wanted = {name: value for name, value in query.items() if value is not None}
    reply = yield from call(Send("GET", "/v1/jobs", options={"params": wanted}))
    body = reply.json()
    return [Job.of(job) for job in body["jobs"]], body["next_cursor"]


def cancel(job_id: str) -> Flow[Job]:
    reply = yield from call(Send("POST", f"/v1/jobs/{job_id}/cancel"))
    return Job.of(reply.json())


def retry(job_id: str, changes: Mapping[str, Any]) -> Flow[Job]:
    headers = {"Idempotency-Key": new_key()}
    options = {"json": dict(changes)}
    reply = yield from call(Send("POST", f"/v1/jobs/{job_id}/retry", headers, options))
    return Job.of(reply.json())


def delete(job_id: str) -> Flow[None]:
    yield from call(Send("DELETE", f"/v1/jobs/{job_id}", repeatable=False))


def fetch_json(path: str) -> Flow[Mapping[str, Any]]:
    reply = yield from call(Send("GET", path))
    return reply.json()


def wait(job_id: str, on_progress: JobCallback | None, timeout: float | None) -> Flow[Job]:
    """Ask until the job has ended; raises JobUnsuccessful or WaitTimeout."""
    begun = time.monotonic()
    while True:
        job = yield from get(job_id)
        if on_progress is not None:
            on_progress(job)
        if job.status == "succeeded":
            return job
        if job.is_finished:
            raise JobUnsuccessful(job)
        waited = time.monotonic() - begun
        if timeout is not None and waited >= timeout:
            raise WaitTimeout(f"The job is still {job.status} after {timeout:g} s.")
        # Asking costs at most a fiftieth of the time that the job takes.
        yield Pause(min(2.0, 0.1 + waited / 50))


def download(job_id: str, name: str, target: Path) -> Flow[Path]:
    """Write an artifact to ``target``, which appears whole and checked or not at all."""
    job = yield from get(job_id)
    artifact = job.artifacts.get(name)
    path = f"/v1/jobs/{job_id}/artifacts/{name}"
    if artifact is None:
        yield from call(Send("GET", path))
        raise DamagedDownload(f"{name} appeared only now; download it again.")
    part = target.with_name(f".{target.name}.part")
    try:
        yield from _fill(path, artifact, part)
        with part.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != artifact.sha256:
                raise DamagedDownload(f"{name} was damaged on its way; download it again.")
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
    return target


def _fill(path: str, artifact: Artifact, part: Path) -> Flow[None]:
    part.write_bytes(b"")
    stalls = 0
    while (have := part.stat().st_size) < artifact.size:
        headers = {"Range": f"bytes={have}-", "If-Range": f'"{artifact.sha256}"'}
        reply = yield Save(path, part, headers if have else {})
        grown = part.stat().st_size > have
        stalls = 0 if grown else stalls + 1
        if isinstance(reply, httpx.Response) and reply.is_success and grown:
            continue
        if stalls == STALLS or not may_pass(reply):
            raise_for(reply)
        yield Pause(pause_seconds(stalls + 1, reply))
