"""The broker: queue names, and the bell that tells workers of a job.

The broker holds nothing that the database does not know. A message names a job; a worker that
gets it still has to claim the job, and a message that is lost is sent again by the reaper.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from service.jobs.model import PRIORITIES
from service.settings import Settings

if TYPE_CHECKING:
    from celery import Celery

log = logging.getLogger(__name__)
TASK_NAME = "visco.run_job"
# The solving process ends itself at its hard limit; when even that hangs, its parent kills it.
_PARENT_GRACE_SECONDS = 15.0


def queue_name(device_class: str, priority: int) -> str:
    return f"visco.{device_class}.{PRIORITIES[priority]}"


def queue_names(device_class: str) -> list[str]:
    """The queues of a device class, the most urgent first."""
    return [queue_name(device_class, p) for p in reversed(range(len(PRIORITIES)))]


def celery_config(settings: Settings) -> dict[str, Any]:
    """What the sending and the receiving side must agree on.

    Messages are acknowledged when a worker takes them, so that Redis never delivers one a second
    time while a long solve runs; what a lost worker leaves is found by its lease. The visibility
    timeout then only concerns messages that were fetched and not yet taken.
    """
    transport = {
        "visibility_timeout": 60,
        "unacked_restore_interval": 5,
        "unacked_restore_throttle": 1,
        "queue_order_strategy": "priority",
        "socket_timeout": 10,
        "socket_connect_timeout": 5,
    }
    return {
        "broker_url": settings.celery_broker_url,
        "broker_transport_options": transport,
        "result_backend_transport_options": {"visibility_timeout": 60},
        "visibility_timeout": 60,
        "broker_connection_retry_on_startup": True,
        "task_ignore_result": True,
        "task_serializer": "json",
        "accept_content": ["json"],
        "worker_hijack_root_logger": False,
    }


class Bell:
    """Rings for a job: a task for the workers, and a wake-up for those who watch its events."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._celery: Celery | None = None
        self._redis: Any = None

    @property
    def redis(self) -> Any:
        if self._redis is None:
            from redis import Redis
            from redis.backoff import NoBackoff
            from redis.retry import Retry

            self._redis = Redis.from_url(
                self.settings.redis_address,
                socket_timeout=2,
                socket_connect_timeout=2,
                retry=Retry(NoBackoff(), 0),
            )
        return self._redis

    def enqueue(self, job_id: str, device_class: str, priority: int, hard_limit: float) -> bool:
        """Tell the workers; False when the broker cannot be reached, and the reaper will."""
        try:
            # Celery would try for seconds to reach a broker that is away.
            self.check()
            self._app().send_task(
                TASK_NAME,
                args=[job_id],
                queue=queue_name(device_class, priority),
                time_limit=hard_limit + _PARENT_GRACE_SECONDS,
                retry=False,
            )
        except Exception as error:  # noqa: BLE001  kombu and redis raise many kinds
            log.warning("The broker was not told of job %s: %s", job_id, error)
            return False
        return True

    def ring(self, job_id: str) -> None:
        """Wake those who watch the job; they read the events from the database."""
        try:
            self.redis.publish(events_channel(job_id), b"")
        except Exception as error:  # noqa: BLE001  watchers poll as well
            log.debug("Watchers of job %s were not woken: %s", job_id, error)

    def waiting(self, device_class: str, priority: int) -> int:
        """Messages in a queue; raises redis.RedisError when the broker is away."""
        return int(self.redis.llen(queue_name(device_class, priority)))

    def check(self) -> None:
        """Raises redis.RedisError when the broker is away."""
        self.redis.ping()

    def close(self) -> None:
        if self._redis is not None:
            self._redis.close()
        if self._celery is not None:
            self._celery.close()

    def _app(self) -> Celery:
        if self._celery is None:
            from celery import Celery

            self._celery = Celery("visco", set_as_current=False)
            self._celery.conf.update(celery_config(self.settings))
        return self._celery


def events_channel(job_id: str) -> str:
    return f"visco:events:{job_id}"
