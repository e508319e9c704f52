"""Is the service there, can it work, and what is it made of?"""

from __future__ import annotations

from datetime import timedelta
from importlib.metadata import version

from fastapi import APIRouter, Response

from service.api.deps import Reader, ServicesDep
from service.api.responses import COMMON, problems
from service.api.schemas import HealthBody, InfoBody, WorkerBody
from service.db import utc_now
from service.errors import ServiceError
from service.jobs.queries import live_workers, status_counts
from service.metrics import CONTENT_TYPE, exposition

router = APIRouter(tags=["service"])


@router.get("/healthz", operation_id="get_health")
def health() -> HealthBody:
    """The process answers."""
    return HealthBody(status="ok")


@router.get("/readyz", responses=problems("not_ready"), operation_id="get_readiness")
def ready(parts: ServicesDep) -> HealthBody:
    """Database, broker and storage can be used."""
    checks = {
        "database": lambda: parts.keys.any_active(),
        "broker": parts.bell.check,
        "storage": parts.storage.check,
    }
    for name, check in checks.items():
        try:
            check()
        except Exception as error:
            raise ServiceError(
                "not_ready",
                f"The {name} cannot be used ({type(error).__name__}); see the service's log.",
                headers={"Retry-After": "2"},
            ) from error
    return HealthBody(status="ok")


@router.get("/info", responses=problems(*COMMON), operation_id="get_info")
def info(_: Reader, parts: ServicesDep) -> InfoBody:
    """Version, workers with their devices, and how much is queued."""
    settings = parts.settings
    since = utc_now() - timedelta(seconds=settings.lease_seconds)
    with parts.database.read() as session:
        counts = status_counts(session)
        workers = live_workers(session, since)
    return InfoBody(
        version=version("visco"),
        workers=[WorkerBody.model_validate(worker, from_attributes=True) for worker in workers],
        queued=counts.get("queued", 0),
        running=counts.get("running", 0),
        max_upload_bytes=settings.max_upload_bytes,
        max_points=settings.max_points,
        keys_needed=settings.keys_needed,
    )


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
    operation_id="get_metrics",
)
def metrics(parts: ServicesDep) -> Response:
    """Prometheus text."""
    return Response(exposition(parts.database, parts.settings), media_type=CONTENT_TYPE)
