"""The Celery side of a worker."""

from __future__ import annotations

import warnings
from typing import Any

from celery import Celery, signals
from celery.platforms import SecurityWarning

from service.jobs.queues import celery_config, queue_names
from service.observability import configure_logging
from service.settings import DeviceClass, Settings
from worker.identity import WorkerIdentity
from worker.parent import Parent


def make_app(settings: Settings) -> Celery:
    """Children are spawned, not forked: CUDA does not survive a fork. One solve at a time."""
    app = Celery("visco", include=["worker.task", "worker.child"])
    app.conf.update(celery_config(settings))
    app.conf.update(
        worker_pool="prefork",
        worker_pool_start_method="spawn",
        worker_concurrency=1,
        worker_prefetch_multiplier=1,
        # A message that waits in a busy worker would keep its job from an idle one.
        worker_disable_prefetch=True,
        worker_enable_remote_control=False,
        worker_send_task_events=False,
        worker_cancel_long_running_tasks_on_connection_loss=False,
        # A first start compiles the kernels before the child counts as alive.
        worker_proc_alive_timeout=900.0,
        worker_redirect_stdouts=False,
    )
    return app


def run_worker(settings: Settings, device_class: DeviceClass, queues: list[str]) -> int:
    """Work until a signal says stop; running jobs then go back to the queue."""
    configure_logging(settings)
    # Celery warns of root because of pickled messages; these are JSON and hold a job's id.
    warnings.filterwarnings("ignore", category=SecurityWarning)
    identity = WorkerIdentity.of_parent(device_class)
    identity.to_environment()
    chosen = queues or queue_names(device_class)
    parent = Parent(settings, identity, chosen)

    def shutting_down(**_: Any) -> None:
        parent.release()

    signals.worker_shutting_down.connect(shutting_down, weak=False)
    app = make_app(settings)
    worker = app.Worker(
        queues=chosen,
        hostname=f"visco@{identity.name}",
        without_gossip=True,
        without_mingle=True,
        without_heartbeat=True,
        quiet=True,
    )
    parent.start()
    try:
        worker.start()
    finally:
        parent.close()
    return int(worker.exitcode or 0)
