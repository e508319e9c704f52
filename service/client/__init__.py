"""A Python client of the service: ``Client`` and ``AsyncClient`` with the same methods."""

from service.client.aio import AsyncClient
from service.client.errors import (
    ApiError,
    ClientError,
    JobUnsuccessful,
    ServiceUnreachable,
    WaitTimeout,
)
from service.client.records import Artifact, Event, Job
from service.client.sync import Client

__all__ = [
    "ApiError",
    "Artifact",
    "AsyncClient",
    "Client",
    "ClientError",
    "Event",
    "Job",
    "JobUnsuccessful",
    "ServiceUnreachable",
    "WaitTimeout",
]
