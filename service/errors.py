"""Everything the service refuses, as one catalogue of stable codes.

ServiceError   a call that cannot be served; its code is a key of ``CATALOGUE``

The catalogue gives each code its HTTP status and title; the raiser adds one sentence that says
what to do. ``docs/errors.md`` lists the same codes, and a test compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Problem:
    """One kind of refusal: HTTP status and a short title that never changes with the case."""

    status: int
    title: str


CATALOGUE: Mapping[str, Problem] = {
    "bad_request": Problem(400, "The request cannot be read"),
    "invalid_cursor": Problem(400, "The page cursor is not one that this service gave out"),
    "unauthenticated": Problem(401, "An API key is needed"),
    "invalid_key": Problem(401, "The API key is unknown or revoked"),
    "forbidden": Problem(403, "The API key may not do this"),
    "forbidden_host": Problem(403, "The Host or Origin is not trusted"),
    "not_found": Problem(404, "There is nothing at this address"),
    "job_not_found": Problem(404, "There is no such job"),
    "upload_not_found": Problem(404, "There is no such upload"),
    "artifact_not_found": Problem(404, "There is no such artifact"),
    "method_not_allowed": Problem(405, "The address does not take this method"),
    "idempotency_conflict": Problem(409, "The Idempotency-Key was used for another request"),
    "job_finished": Problem(409, "The job has already finished"),
    "job_not_finished": Problem(409, "The job has not finished yet"),
    "offset_mismatch": Problem(409, "The upload continues at another offset"),
    "upload_incomplete": Problem(409, "The upload has not been completed"),
    "artifact_expired": Problem(410, "The stored bytes have expired"),
    "upload_expired": Problem(410, "The upload has expired"),
    "tus_version": Problem(412, "Only version 1.0.0 of the tus protocol is spoken"),
    "too_large": Problem(413, "The body is too large"),
    "too_many_points": Problem(413, "The scan declares too many points"),
    "not_a_point_cloud": Problem(415, "The file is not a point cloud that can be read"),
    "unsupported_media_type": Problem(415, "The body's Content-Type is not taken here"),
    "range_not_satisfiable": Problem(416, "The Range lies outside the file"),
    "invalid_params": Problem(422, "A parameter is unknown or out of range"),
    "invalid_request": Problem(422, "A field of the request is missing or wrong"),
    "callback_refused": Problem(422, "The callback_url may not be called"),
    "rate_limited": Problem(429, "Too many requests"),
    "quota_queued": Problem(429, "Too many jobs are queued"),
    "checksum_mismatch": Problem(460, "The bytes do not match their checksum"),
    "internal_error": Problem(500, "The service failed"),
    "not_ready": Problem(503, "A part of the service is not available"),
    "storage_full": Problem(507, "The storage is full"),
    "quota_storage": Problem(507, "The owner's storage is used up"),
}

JOB_FAILURES: Mapping[str, str] = {
    "worker_lost": "The workers of several attempts in a row went away in mid-solve",
    "hard_limit": "The solve did not end within its hard time limit",
    "input_lost": "The stored scan is missing or damaged",
    "storage_full": "The results could not be stored",
    "internal_error": "The worker met an error that it did not expect",
}


@dataclass(frozen=True)
class FieldError:
    """One wrong field: its path, such as ``params.resolution``, and a sentence."""

    path: str
    detail: str


@dataclass(eq=False)
class ServiceError(Exception):
    """A call that cannot be served; ``detail`` is one sentence that says what to do."""

    code: str
    detail: str
    headers: Mapping[str, str] = field(default_factory=dict)
    errors: Sequence[FieldError] = ()

    def __str__(self) -> str:
        return self.detail

    @property
    def status(self) -> int:
        return CATALOGUE[self.code].status

    def body(self, request_id: str) -> dict[str, Any]:
        """The problem+json body (RFC 9457)."""
        problem = CATALOGUE[self.code]
        body: dict[str, Any] = {
            "type": f"urn:visco:problem:{self.code}",
            "title": problem.title,
            "status": problem.status,
            "code": self.code,
            "detail": self.detail,
            "request_id": request_id,
        }
        if self.errors:
            body["errors"] = [{"path": e.path, "detail": e.detail} for e in self.errors]
        return body
