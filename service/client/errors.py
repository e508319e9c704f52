"""What can go wrong with a call, as one tree.

ClientError
├── ApiError            the service refused; ``code`` is stable
├── ServiceUnreachable  no answer, after all tries
├── JobUnsuccessful     the job that was waited for failed or was cancelled
├── WaitTimeout         the job is not finished after the time that was given
└── DamagedDownload     the bytes that arrived are not those that the service stored
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from service.client.records import Job


class ClientError(Exception):
    """Base of all errors of the client."""


class ApiError(ClientError):
    """The service refused a call; the message is its advice."""

    def __init__(self, status: int, problem: Mapping[str, Any]) -> None:
        super().__init__(problem.get("detail") or f"The service answered {status}.")
        self.status = status
        self.code: str = problem.get("code", "unknown")
        self.request_id: str = problem.get("request_id", "")
        self.errors: Sequence[Mapping[str, str]] = problem.get("errors", ())


class ServiceUnreachable(ClientError):
    """There was no answer, after all tries."""


class JobUnsuccessful(ClientError):
    """The job failed or was cancelled."""

    def __init__(self, job: Job) -> None:
        super().__init__(job.error_detail or f"The job was {job.status}.")
        self.job = job


class WaitTimeout(ClientError):
    """The job goes on, but the time to wait for it is over."""


class DamagedDownload(ClientError):
    """The bytes that arrived are not those that the service stored."""
