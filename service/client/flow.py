"""Calls without a network: generators that say what to send, and are told what came back.

``Client`` and ``AsyncClient`` only differ in how they carry the actions out. An answer that never
came is handed in as an exception, so that trying again is decided here, once for both.
"""

from __future__ import annotations

import logging
import random
import uuid
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import httpx

from service.client.errors import ApiError, ClientError, ServiceUnreachable

log = logging.getLogger(__name__)
T = TypeVar("T")
_TRIES = 7
_FIRST_PAUSE, _LONGEST_PAUSE = 0.25, 8.0
# Whoever waits longer than this wants to know for what.
_NOTICEABLE_PAUSE = 1.0
_TRY_AGAIN = frozenset({429, 502, 503, 504})


@dataclass(frozen=True)
class Send:
    """A request. ``repeatable`` ones may reach the service twice without harm."""

    method: str
    path: str
    headers: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    repeatable: bool = True


@dataclass(frozen=True)
class Save:
    """A request whose answer's body is appended to a file."""

    path: str
    target: Path
    headers: Mapping[str, str]


@dataclass(frozen=True)
class Pause:
    seconds: float


Action = Send | Save | Pause
Reply = httpx.Response | httpx.TransportError | None
Flow = Generator[Action, Reply, T]


def call(request: Send) -> Flow[httpx.Response]:
    """Send, and try again with growing pauses; raises ApiError or ServiceUnreachable."""
    for tried in range(1, _TRIES + 1):
        reply = yield request
        if isinstance(reply, httpx.Response) and reply.is_success:
            return reply
        retry = request.repeatable or _was_refused(reply)
        if tried == _TRIES or not (retry and may_pass(reply)):
            raise_for(reply)
        pause = pause_seconds(tried, reply)
        if pause >= _NOTICEABLE_PAUSE:
            log.warning("%s Trying again in %.0f s.", _trouble(reply), pause)
        yield Pause(pause)
    raise AssertionError


def may_pass(reply: Reply) -> bool:
    """Whether trouble may be over soon: a cut, too busy, or being restarted."""
    if not isinstance(reply, httpx.Response):
        return True
    return reply.is_success or reply.status_code in _TRY_AGAIN


def _was_refused(reply: Reply) -> bool:
    """Whether the service certainly did nothing with the request."""
    if isinstance(reply, httpx.Response):
        return reply.status_code == 429
    return isinstance(reply, httpx.ConnectError | httpx.ConnectTimeout)


def pause_seconds(tried: int, reply: Reply) -> float:
    """Doubling, with chance in it so that many clients do not come back at once."""
    if isinstance(reply, httpx.Response):
        asked = reply.headers.get("retry-after", "")
        if asked.isdigit():
            return float(asked)
    longest = min(_LONGEST_PAUSE, _FIRST_PAUSE * 2 ** (tried - 1))
    return longest * random.uniform(0.5, 1.0)


def raise_for(reply: Reply) -> None:
    """Raises what an answer, or none, means."""
    trouble = _trouble(reply)
    raise trouble from reply if isinstance(reply, Exception) else None


def _trouble(reply: Reply) -> ClientError:
    if isinstance(reply, httpx.Response):
        try:
            problem = reply.json()
        except ValueError:
            problem = {}
        return ApiError(reply.status_code, problem if isinstance(problem, dict) else {})
    if reply is None:
        return ServiceUnreachable("The service does not answer.")
    url = reply.request.url
    return ServiceUnreachable(
        f"No service answers at {url.scheme}://{url.netloc.decode()} ({reply}); "
        "check the address, or start one with `visco serve`."
    )


def new_key() -> str:
    """A fresh Idempotency-Key."""
    return uuid.uuid4().hex
