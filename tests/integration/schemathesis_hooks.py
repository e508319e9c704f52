"""Read by schemathesis: what a schema cannot say of good input."""

from __future__ import annotations

import base64
import hashlib
from typing import Any

import schemathesis
from schemathesis.transport.serialization import Binary
from servicekit import sphere_scan

SCAN = sphere_scan(40).decode()


def as_bytes(value: object) -> bytes:
    if isinstance(value, Binary):
        return value.data
    return value if isinstance(value, bytes) else str(value).encode()


@schemathesis.serializer("application/offset+octet-stream")
def piece(context: object, value: object) -> bytes:
    return as_bytes(value)


@schemathesis.hook
def before_call(context: object, case: schemathesis.Case, kwargs: object) -> None:
    """Good input is made better than its schema can say; what is to be refused stays as it is."""
    if case.meta is None or case.meta.generation.mode.is_negative:
        return
    if case.headers and "upload-checksum" in case.headers:
        digest = hashlib.sha1(as_bytes(case.body), usedforsecurity=False).digest()
        case.headers["upload-checksum"] = f"sha1 {base64.b64encode(digest).decode()}"
    if isinstance(case.body, dict):
        # Cases share their parts, so nothing is changed in place.
        case.body = _job(case.body) if case.path == "/v1/jobs" else _params(case.body)


def _job(body: dict[str, Any]) -> dict[str, Any]:
    """Either a file, which is a scan, or an upload_id."""
    body = {name: value for name, value in body.items() if name != "upload_id"}
    if isinstance(body.get("params"), dict):
        body["params"] = _params(body["params"])
    return {**body, "file": SCAN}


def _params(params: dict[str, Any]) -> dict[str, Any]:
    """A box's low corner is below its high one, and nobody is called."""
    better = dict(params)
    if isinstance(params.get("callback_url"), str):
        better["callback_url"] = "https://nowhere.invalid/"
    if params.get("crop") is not None:
        lows, highs = params["crop"][:3], params["crop"][3:]
        better["crop"] = [min(low, 0.0) for low in lows] + [max(high, 0.0) + 1 for high in highs]
    return better
