"""Resumable uploads: the core of tus 1.0 with creation, checksum, expiration and termination."""

from __future__ import annotations

import base64
import hmac
import re
from email.utils import format_datetime
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from service.api.deps import Reader, ServicesDep, Writer
from service.api.responses import COMMON, problems
from service.api.schemas import FailureBody, UploadBody
from service.errors import ServiceError
from service.uploads.model import Upload
from service.uploads.received import Receiver
from service.uploads.service import check_offset

router = APIRouter(prefix="/uploads", tags=["uploads"])
_VERSION = "1.0.0"
_PIECE = "application/offset+octet-stream"
_WRITE_BYTES = 1 << 20
_PIECE_BODY = {
    "requestBody": {
        "required": True,
        "content": {_PIECE: {"schema": {"type": "string", "format": "binary"}}},
    }
}
# Patterns are for readers of the description; the routes check with words of their own.
_COUNT = {"pattern": "^[0-9]{1,18}$"}
_BASE64 = "([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?"
# A name of printable characters but the comma, and a value that may be left out.
_PAIR = rf"[!-+\--~]+( {_BASE64})?"
_METADATA = f"^({_PAIR}(,{_PAIR})*)?$"
_CHECKSUM = "^(sha256 [A-Za-z0-9+/]{43}=|sha1 [A-Za-z0-9+/]{27}=)$"
TusVersion = Annotated[
    str | None, Header(alias="Tus-Resumable", json_schema_extra={"enum": [_VERSION]})
]


@router.options("", status_code=204, operation_id="get_upload_protocol")
def protocol(parts: ServicesDep) -> Response:
    """What the upload protocol offers here."""
    headers = {
        "Tus-Resumable": _VERSION,
        "Tus-Version": _VERSION,
        "Tus-Extension": "creation,checksum,expiration,termination",
        "Tus-Max-Size": str(parts.settings.max_upload_bytes),
        "Tus-Checksum-Algorithm": "sha256,sha1",
    }
    return Response(status_code=204, headers=headers)


@router.post(
    "",
    status_code=201,
    responses=problems(
        *COMMON, "bad_request", "tus_version", "too_large", "storage_full", "quota_storage"
    ),
    operation_id="create_upload",
)
def create_upload(
    request: Request,
    response: Response,
    principal: Writer,
    parts: ServicesDep,
    upload_length: Annotated[
        str, Header(description="Size of the whole file in bytes.", json_schema_extra=_COUNT)
    ],
    upload_metadata: Annotated[
        str | None,
        Header(
            description="`filename` and its name in base64.",
            json_schema_extra={"pattern": _METADATA},
        ),
    ] = None,
    tus_resumable: TusVersion = None,
) -> UploadBody:
    """Begin an upload; Location says where its bytes are to be sent."""
    _check_version(tus_resumable)
    size = _number("Upload-Length", upload_length)
    name = _file_name(upload_metadata or "")
    upload = parts.uploads.create(principal, name, size)
    response.headers.update(_state(upload))
    # Standard tus clients take the Location as it is, so it is a whole address.
    response.headers["Location"] = str(request.url_for("get_upload", upload_id=upload.id))
    return _body(upload)


@router.get(
    "/{upload_id}",
    responses=problems(*COMMON, "upload_not_found", "upload_expired", "tus_version"),
    operation_id="get_upload",
)
@router.head(
    "/{upload_id}",
    responses=problems(*COMMON, "upload_not_found", "upload_expired", "tus_version"),
    operation_id="get_upload_offset",
)
def get_upload(
    upload_id: str,
    response: Response,
    principal: Reader,
    parts: ServicesDep,
    tus_resumable: TusVersion = None,
) -> UploadBody:
    """How far an upload is: Upload-Offset says where to go on. HEAD gives the headers alone."""
    _check_version(tus_resumable)
    upload = parts.uploads.get(principal, upload_id)
    response.headers.update(_state(upload))
    return _body(upload)


@router.patch(
    "/{upload_id}",
    status_code=204,
    openapi_extra=_PIECE_BODY,
    responses=problems(
        *COMMON,
        "bad_request",
        "upload_not_found",
        "upload_expired",
        "offset_mismatch",
        "tus_version",
        "too_large",
        "too_many_points",
        "not_a_point_cloud",
        "unsupported_media_type",
        "checksum_mismatch",
        "storage_full",
    ),
    operation_id="append_upload",
)
async def append_upload(
    upload_id: str,
    request: Request,
    principal: Writer,
    parts: ServicesDep,
    upload_offset: Annotated[
        str, Header(description="Where these bytes belong.", json_schema_extra=_COUNT)
    ],
    upload_checksum: Annotated[
        str | None,
        Header(
            description="`sha256` or `sha1`, and the digest in base64.",
            examples=["sha1 2jmj7l5rSw0yVb/vlWAYkK/YBwk="],
            json_schema_extra={"pattern": _CHECKSUM},
        ),
    ] = None,
    tus_resumable: TusVersion = None,
) -> Response:
    """Send the next bytes. Those that arrived before a cut are kept, unless a checksum is sent."""
    _check_version(tus_resumable)
    if request.headers.get("content-type") != _PIECE:
        raise ServiceError("unsupported_media_type", f"Send the bytes as {_PIECE}.")
    expected = _checksum(upload_checksum)
    upload = await run_in_threadpool(parts.uploads.get, principal, upload_id)
    offset = _number("Upload-Offset", upload_offset)
    check_offset(upload, offset)
    if upload.is_complete:
        return Response(status_code=204, headers=_state(upload))
    with parts.uploads.receive_piece(upload, offset) as receiver:
        whole = await _receive(request, receiver)
        if expected is not None and not (whole and _verified(receiver, expected)):
            raise ServiceError("checksum_mismatch", "Send these bytes again from the same offset.")
        piece = receiver.keep()
    upload = await run_in_threadpool(parts.uploads.append, upload, offset, piece)
    return Response(status_code=204, headers=_state(upload))


@router.delete(
    "/{upload_id}",
    status_code=204,
    responses=problems(*COMMON, "upload_not_found", "upload_expired", "tus_version"),
    operation_id="delete_upload",
)
def delete_upload(
    upload_id: str, principal: Writer, parts: ServicesDep, tus_resumable: TusVersion = None
) -> Response:
    """Give an upload up; jobs that use it keep its bytes."""
    _check_version(tus_resumable)
    parts.uploads.delete(principal, upload_id)
    return Response(status_code=204, headers={"Tus-Resumable": _VERSION})


async def _receive(request: Request, receiver: Receiver) -> bool:
    """Write what comes; False when the connection was cut before the end."""
    pending = bytearray()
    whole = True
    try:
        async for chunk in request.stream():
            pending += chunk
            if len(pending) >= _WRITE_BYTES:
                await run_in_threadpool(receiver.write, bytes(pending))
                pending.clear()
    except ClientDisconnect:
        whole = False
    await run_in_threadpool(receiver.write, bytes(pending))
    return whole


def _check_version(given: str | None) -> None:
    if given not in (None, _VERSION):
        raise ServiceError(
            "tus_version", "Send Tus-Resumable: 1.0.0.", headers={"Tus-Version": _VERSION}
        )


def _number(header: str, text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 18:
        raise ServiceError("bad_request", f"{header} must be a whole number of bytes.")
    return int(text)


def _file_name(metadata: str) -> str:
    """The name in ``filename d29ybGQ=,other dGhpbmc=``; what else there is does not matter here."""
    if not re.fullmatch(_METADATA, metadata):
        raise ServiceError("bad_request", "Upload-Metadata must hold names with base64 values.")
    pairs = (pair.partition(" ") for pair in metadata.split(","))
    values = {name: value for name, _, value in pairs}
    return base64.b64decode(values.get("filename", "")).decode(errors="replace")


def _checksum(header: str | None) -> tuple[str, bytes] | None:
    if header is None:
        return None
    if not re.fullmatch(_CHECKSUM, header):
        raise ServiceError(
            "bad_request", "Upload-Checksum must be 'sha256' or 'sha1' and the digest in base64."
        )
    algorithm, _, encoded = header.partition(" ")
    return algorithm, base64.b64decode(encoded)


def _verified(receiver: Receiver, expected: tuple[str, bytes]) -> bool:
    algorithm, digest = expected
    return hmac.compare_digest(receiver.hashes[algorithm].digest(), digest)


def _state(upload: Upload) -> dict[str, str]:
    return {
        "Tus-Resumable": _VERSION,
        "Upload-Offset": str(upload.offset),
        "Upload-Length": str(upload.size),
        "Upload-Expires": format_datetime(upload.expires_at, usegmt=True),
        "Cache-Control": "no-store",
    }


def _body(upload: Upload) -> UploadBody:
    refusal = None
    if upload.refusal_code is not None:
        refusal = FailureBody(code=upload.refusal_code, detail=upload.refusal_detail or "")
    return UploadBody(
        id=upload.id,
        name=upload.name,
        size=upload.size,
        offset=upload.offset,
        complete=upload.is_complete,
        points=upload.points,
        error=refusal,
        expires_at=upload.expires_at,
    )
