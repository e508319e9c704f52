"""What Prometheus reads: this process's requests, and the queue as the database has it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import timedelta

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.exposition import generate_latest
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from service.db import Database, utc_now
from service.jobs.model import PRIORITIES
from service.jobs.queries import live_workers, queue_depths, status_counts
from service.settings import Settings

_METHODS = frozenset({"GET", "HEAD", "POST", "PATCH", "DELETE", "OPTIONS", "PUT"})
CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_registry = CollectorRegistry()
_requests = Counter(
    "visco_http_requests", "Requests answered.", ("method", "route", "status"), registry=_registry
)
_seconds = Histogram(
    "visco_http_request_seconds",
    "Time to answer a request; streams count until they end.",
    ("method", "route"),
    registry=_registry,
)


def observe_request(method: str, route: str, status: int, seconds: float) -> None:
    method = method if method in _METHODS else "other"
    _requests.labels(method, route, str(status)).inc()
    _seconds.labels(method, route).observe(seconds)


class _JobMetrics(Collector):
    """Read when asked for: any process gives the same numbers."""

    def __init__(self, database: Database, settings: Settings) -> None:
        self.database = database
        self.settings = settings

    def collect(self) -> Iterable[Metric]:
        since = utc_now() - timedelta(seconds=self.settings.lease_seconds)
        with self.database.read() as session:
            statuses = status_counts(session)
            depths = queue_depths(session)
            workers = [worker.device_class for worker in live_workers(session, since)]
        jobs = GaugeMetricFamily("visco_jobs", "Jobs by status.", labels=["status"])
        for status in ("queued", "running", "succeeded", "failed", "cancelled"):
            jobs.add_metric([status], statuses.get(status, 0))
        depth = GaugeMetricFamily(
            "visco_queue_depth", "Queued jobs.", labels=["device_class", "priority"]
        )
        for (device_class, priority), count in depths.items():
            depth.add_metric([device_class, PRIORITIES[priority]], count)
        alive = GaugeMetricFamily("visco_workers", "Workers alive.", labels=["device_class"])
        for device_class in ("cpu", "cuda"):
            alive.add_metric([device_class], workers.count(device_class))
        return jobs, depth, alive


def exposition(database: Database, settings: Settings) -> bytes:
    """All metrics in Prometheus' text form."""
    registry = CollectorRegistry()
    registry.register(_JobMetrics(database, settings))
    return generate_latest(_registry) + generate_latest(registry)
