"""Every refusal as one kind of body: application/problem+json."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from service.errors import FieldError, ServiceError
from service.jobs.params import refuse_params
from service.observability import request_id
from service.openapi import allowed_methods

log = logging.getLogger(__name__)
_BY_STATUS = {
    400: ("bad_request", "Check the request against the API's description."),
    404: ("not_found", "GET /openapi.json lists every address."),
    405: ("method_not_allowed", "The Allow header names the methods that this address takes."),
    413: ("too_large", "Send a smaller body."),
    415: ("unsupported_media_type", "Check the Content-Type against the API's description."),
}


def problem_response(error: ServiceError) -> JSONResponse:
    return JSONResponse(
        error.body(request_id.get()),
        status_code=error.status,
        headers=dict(error.headers),
        media_type="application/problem+json",
    )


def install(app: FastAPI) -> None:
    """Map every exception that can leave a route to a code of the catalogue."""

    @app.exception_handler(ServiceError)
    async def refused(_request: Request, error: ServiceError) -> JSONResponse:
        return problem_response(error)

    @app.exception_handler(RequestValidationError)
    async def invalid(_request: Request, error: RequestValidationError) -> JSONResponse:
        if all(item["loc"][0] == "body" for item in error.errors()):
            # The one body that is not read by its route is that of a retry: its params.
            return problem_response(refuse_params(_in_params(error.errors())))
        errors = [_field_error(item) for item in error.errors()]
        first = errors[0]
        return problem_response(
            ServiceError("invalid_request", f"{first.path}: {first.detail}", errors=errors)
        )

    @app.exception_handler(HTTPException)
    async def http_error(request: Request, error: HTTPException) -> JSONResponse:
        code, detail = _BY_STATUS.get(error.status_code, ("internal_error", str(error.detail)))
        if error.status_code == 404:
            detail = f"There is nothing at {request.url.path[:200]}; {detail}"
        headers = dict(error.headers or {})
        if error.status_code == 405:
            headers["Allow"] = allowed_methods(app, request.url.path) or headers.get("Allow", "")
        return problem_response(ServiceError(code, detail, headers=headers))

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> JSONResponse:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem_response(
            ServiceError("internal_error", "Try again; if it stays, report the request id.")
        )


def _in_params(items: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for item in items:
        # Of a body that is no JSON the second entry is the character.
        path = () if item["type"] == "json_invalid" else item["loc"][1:]
        yield {**item, "loc": path}


def _field_error(item: dict[str, Any]) -> FieldError:
    return FieldError(".".join(str(part) for part in item["loc"]), f"{item['msg']}.")
