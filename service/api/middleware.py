"""What surrounds every request: its id, its log line, its measurement, its size limit."""

from __future__ import annotations

import logging
import re
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.handlers import problem_response
from service.db import new_id
from service.errors import ServiceError
from service.metrics import observe_request
from service.observability import accepted_request_id, request_id

log = logging.getLogger("service.access")
_SMALL_BODY = 1 << 20
# These two read scans; they watch the size themselves while they write it to the disk.
_LARGE_BODIES = re.compile(r"POST /v1/jobs|PATCH /v1/uploads/[^/]+|POST /v1/uploads/[^/]+")
_SECURITY = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}


class RequestContext:
    """Outermost middleware; plain ASGI, so that streams pass through unbuffered."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        given = accepted_request_id(headers.get("x-request-id"))
        token = request_id.set(given or new_id())
        started = time.perf_counter()
        status = 500

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                answer = MutableHeaders(scope=message)
                answer["X-Request-ID"] = request_id.get()
                for name, value in _SECURITY.items():
                    answer.setdefault(name, value)
            await send(message)

        try:
            await self._limited(scope, headers, receive, send_with_id)
        finally:
            seconds = time.perf_counter() - started
            _finished(scope, status, seconds)
            request_id.reset(token)

    async def _limited(self, scope: Scope, headers: Headers, receive: Receive, send: Send) -> None:
        if _LARGE_BODIES.fullmatch(f"{scope['method']} {scope['path']}"):
            await self.app(scope, receive, send)
            return
        declared = headers.get("content-length", "")
        if declared.isdigit() and int(declared) > _SMALL_BODY:
            refusal = ServiceError("too_large", f"Send at most {_SMALL_BODY:,} bytes here.")
            await problem_response(refusal)(scope, receive, send)
            return
        seen = 0

        async def counted() -> Message:
            nonlocal seen
            message = await receive()
            seen += len(message.get("body", b""))
            if seen > _SMALL_BODY:
                raise HTTPException(413)
            return message

        await self.app(scope, counted, send)


def _finished(scope: Scope, status: int, seconds: float) -> None:
    route = scope.get("route")
    path = getattr(route, "path", "unmatched")
    observe_request(scope["method"], path, status, seconds)
    # Pages and clients that watch a job read all the time; that would drown what changes something.
    reads = scope["method"] in ("GET", "HEAD") and status < 400
    log.log(
        logging.DEBUG if reads else logging.INFO,
        "%s %s %s in %.0f ms",
        scope["method"],
        scope["path"],
        status,
        seconds * 1000,
        extra={"status": status, "seconds": round(seconds, 4), "route": path},
    )
