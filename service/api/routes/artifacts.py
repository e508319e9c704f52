"""A job's results and its events."""

from __future__ import annotations

import json
import time
from collections.abc import AsyncIterator
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Header, Request, Response
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event
from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse

from service.api.deps import Reader, ServicesDep
from service.api.responses import COMMON, artifact_response, problems
from service.api.schemas import ArtifactBody, ArtifactListBody
from service.errors import ServiceError
from service.events import EventFeed
from service.jobs.model import Event
from service.jobs.state import EventType

router = APIRouter(prefix="/jobs/{job_id}", tags=["jobs"])
_HEARTBEAT_SECONDS = 10.0
_RECONNECT_MILLISECONDS = 1000
_BINARY = {"schema": {"type": "string", "format": "binary"}}
# As OpenAPI 3.2 describes the items of a stream.
_EVENT = {
    "type": "object",
    "properties": {
        "id": {"type": "string", "pattern": "^[1-9][0-9]*$"},
        "event": {"type": "string", "enum": list(get_args(EventType))},
        "data": {
            "type": "string",
            "contentMediaType": "application/json",
            "contentSchema": {
                "type": "object",
                "properties": {"at": {"type": "string", "format": "date-time"}},
                "required": ["at"],
            },
        },
    },
    "required": ["id", "event", "data"],
}
_FILE_TYPES = dict.fromkeys(
    ("model/gltf-binary", "application/octet-stream", "image/png", "text/plain"), _BINARY
)


@router.get(
    "/artifacts", responses=problems(*COMMON, "job_not_found"), operation_id="list_artifacts"
)
def list_artifacts(job_id: str, principal: Reader, parts: ServicesDep) -> ArtifactListBody:
    """The files that the job has left so far; level-*.glb appear while it runs."""
    found = parts.jobs.artifacts(principal, job_id)
    return ArtifactListBody(artifacts=[ArtifactBody.of(artifact) for artifact in found])


_FILE_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {"content": {**_FILE_TYPES, "application/json": {}}, "description": "The file"},
    206: {"content": _FILE_TYPES, "description": "The bytes that Range asked for"},
    304: {"description": "If-None-Match holds the file's ETag"},
    **problems(
        *COMMON, "job_not_found", "artifact_not_found", "artifact_expired", "range_not_satisfiable"
    ),
}


@router.get(
    "/artifacts/{name}",
    response_class=Response,
    responses=_FILE_ANSWERS,
    operation_id="get_artifact",
)
@router.head(
    "/artifacts/{name}",
    response_class=Response,
    responses=_FILE_ANSWERS,
    operation_id="get_artifact_headers",
)
def get_artifact(
    job_id: str, name: str, request: Request, principal: Reader, parts: ServicesDep
) -> Response:
    """One file. Answers ETag with If-None-Match, and one Range."""
    artifact = parts.jobs.artifact(principal, job_id, name)
    return artifact_response(request, artifact, parts.storage)


@router.get(
    "/events",
    response_class=StreamingResponse,
    responses={
        200: {
            "content": {
                "text/event-stream": {
                    "itemSchema": _EVENT,
                    "example": 'id: 2\nevent: started\ndata: {"attempt": 1}\n\n',
                }
            },
            "description": "Events with ids, to the job's last one",
        },
        204: {"description": "The job has ended and there is nothing after Last-Event-ID"},
        **problems(*COMMON, "job_not_found"),
    },
    operation_id="follow_job",
)
async def follow_job(
    job_id: str,
    principal: Reader,
    parts: ServicesDep,
    last_event_id: Annotated[
        str | None,
        Header(
            description="Continue after this event, as browsers do by themselves.",
            json_schema_extra={"pattern": "^[0-9]{0,9}$"},
        ),
    ] = None,
) -> Response:
    """Server-sent events of the job: queued, started, progress, level, … and its end."""
    after = _sequence(last_event_id)
    job, _ = await run_in_threadpool(parts.jobs.get, principal, job_id)
    if job.is_terminal and after >= job.last_sequence:
        # 204 tells a browser's EventSource not to connect again.
        return Response(status_code=204)
    return StreamingResponse(
        _stream(parts.feed, job_id, after),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


def _sequence(header: str | None) -> int:
    if header is None or header == "":
        return 0
    if not header.isascii() or not header.isdigit() or len(header) > 9:
        raise ServiceError("invalid_request", "Last-Event-ID must be the id of an event.")
    return int(header)


async def _stream(feed: EventFeed, job_id: str, after: int) -> AsyncIterator[bytes]:
    yield format_sse_event(retry=_RECONNECT_MILLISECONDS)
    sent = time.monotonic()
    async for event in feed.follow(job_id, after):
        if event is not None:
            yield _event_bytes(event)
        elif time.monotonic() - sent < _HEARTBEAT_SECONDS:
            continue
        else:
            yield KEEPALIVE_COMMENT
        sent = time.monotonic()


def _event_bytes(event: Event) -> bytes:
    data = {**event.data, "at": event.created_at.isoformat()}
    return format_sse_event(data_str=json.dumps(data), event=event.type, id=str(event.sequence))
