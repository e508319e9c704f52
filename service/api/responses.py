"""Files over HTTP: ETag, 304 and one Range; and the problems that the API description names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from fastapi import Request
from starlette.responses import Response, StreamingResponse

from service.api.schemas import ProblemBody
from service.errors import CATALOGUE, ServiceError
from service.jobs.model import Artifact
from service.storage import Storage, StoredBytesMissing

_RANGE = re.compile(r"bytes=(\d*)-(\d*)")


def artifact_response(request: Request, artifact: Artifact, storage: Storage) -> Response:
    """Raises ServiceError (``artifact_expired``, ``range_not_satisfiable``)."""
    etag = f'"{artifact.sha256}"'
    headers = {
        "ETag": etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, no-cache",
        "Content-Disposition": f'attachment; filename="{artifact.name}"',
    }
    if _matches(request.headers.get("if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    span = None
    if request.headers.get("if-range", etag) == etag:
        span = _span(request.headers.get("range"), artifact.size)
    start, end = span or (0, artifact.size)
    if span is not None:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{artifact.size}"
    headers["Content-Length"] = str(end - start)
    status = 200 if span is None else 206
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers, media_type=artifact.content_type)
    return StreamingResponse(
        _bytes(storage, artifact, start, end - start),
        status_code=status,
        headers=headers,
        media_type=artifact.content_type,
    )


def _bytes(storage: Storage, artifact: Artifact, start: int, length: int) -> Iterator[bytes]:
    try:
        return storage.read(artifact.key, start, length)
    except StoredBytesMissing:
        raise ServiceError(
            "artifact_expired", "Run the job again with /retry; its stored bytes are gone."
        ) from None


def _matches(header: str | None, etag: str) -> bool:
    if header is None:
        return False
    return header.strip() == "*" or etag in [
        item.strip().removeprefix("W/") for item in header.split(",")
    ]


def _span(header: str | None, size: int) -> tuple[int, int] | None:
    """The asked bytes as [start, end), or None for the whole file.

    What is no single range of bytes is ignored, as RFC 9110 allows.
    """
    match = _RANGE.fullmatch(header.strip()) if header else None
    if match is None or not (match[1] or match[2]):
        return None
    if match[1]:
        start = int(match[1])
        end = min(int(match[2]) + 1, size) if match[2] else size
        if match[2] and int(match[2]) < start:
            return None
    else:
        start, end = max(0, size - int(match[2])), size
    if start >= end:
        raise ServiceError(
            "range_not_satisfiable",
            f"Ask for bytes below {size}.",
            headers={"Content-Range": f"bytes */{size}"},
        )
    return start, end


def problems(*codes: str) -> dict[int | str, dict[str, Any]]:
    """The refusals of a route for the API description, with an example each."""
    answers: dict[int | str, dict[str, Any]] = {}
    for code in codes:
        kind = CATALOGUE[code]
        answer = answers.setdefault(
            kind.status,
            {
                "model": ProblemBody,
                "description": kind.title,
                "content": {"application/problem+json": {"examples": {}}},
            },
        )
        body = ServiceError(code, "One sentence that says what to do.").body("01kx")
        answer["content"]["application/problem+json"]["examples"][code] = {"value": body}
    return answers


COMMON = ("unauthenticated", "forbidden", "rate_limited", "invalid_request")
