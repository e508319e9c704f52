"""Named dependencies: the services, and the caller with the scope that a route needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request, Security
from fastapi.security import APIKeyHeader, HTTPBearer
from fastapi.security.http import HTTPAuthorizationCredentials
from starlette.concurrency import run_in_threadpool

from service.api.container import Services
from service.auth.principal import LOCAL_USER, Principal, Scope
from service.errors import ServiceError
from service.settings import LOOPBACK_HOSTS

_bearer = HTTPBearer(auto_error=False, description="An API key made by `visco keys create`.")
_header = APIKeyHeader(name="X-API-Key", auto_error=False, description="The same key.")


# A proxy on this machine makes the whole world look local.
_FORWARDED = ("forwarded", "x-forwarded-for", "x-real-ip", "via")


def services(request: Request) -> Services:
    return request.app.state.services


ServicesDep = Annotated[Services, Depends(services)]


async def caller(
    request: Request,
    parts: ServicesDep,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Security(_bearer)],
    header: Annotated[str | None, Security(_header)],
) -> Principal:
    """Whom the call acts for; every call is counted, a refused one against its address."""
    address = request.client.host if request.client else "unknown"
    secret = bearer.credentials if bearer is not None else header
    if secret is None and not parts.settings.keys_needed:
        _check_local(request, parts.settings.trusted_hosts)
        await run_in_threadpool(parts.limiter.check, f"local:{address}")
        return LOCAL_USER
    try:
        if secret is None:
            raise ServiceError(
                "unauthenticated",
                "Send an API key as 'Authorization: Bearer …' (commands: --key or VISCO_KEY); "
                "`visco keys create` makes one.",
                headers={"WWW-Authenticate": "Bearer"},
            )
        principal = await run_in_threadpool(parts.keys.check, secret)
    except ServiceError:
        await run_in_threadpool(parts.limiter.check, f"refused:{address}")
        raise
    await run_in_threadpool(parts.limiter.check, f"key:{principal.key_id}")
    return principal


def _check_local(request: Request, trusted: tuple[str, ...]) -> None:
    """A page on another site can make a browser call loopback; it cannot forge these headers."""
    if any(name in request.headers for name in _FORWARDED):
        raise ServiceError(
            "forbidden_host",
            "The call came through a proxy; set VISCO_REQUIRE_KEYS=true and send an API key.",
        )
    host = _host_name(request.headers.get("host", ""))
    origin = request.headers.get("origin")
    known = {*LOOPBACK_HOSTS, *trusted}
    if host not in known or (origin is not None and urlsplit(origin).hostname not in known):
        raise ServiceError(
            "forbidden_host",
            "Without an API key only pages and programs of this machine are served; "
            "call 127.0.0.1, or name the host in VISCO_TRUSTED_HOSTS.",
        )


def _host_name(header: str) -> str:
    try:
        return urlsplit(f"//{header}").hostname or ""
    except ValueError:
        return ""


def _scoped(scope: Scope) -> Callable[[Principal], Principal]:
    def check(principal: Annotated[Principal, Depends(caller)]) -> Principal:
        principal.require(scope)
        return principal

    return check


Reader = Annotated[Principal, Depends(_scoped("read"))]
Writer = Annotated[Principal, Depends(_scoped("write"))]
