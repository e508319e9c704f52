"""The one Celery task, and what the parent does when its child is lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from billiard.exceptions import TimeLimitExceeded, WorkerLostError
from celery import shared_task, signals

from service.jobs.queues import TASK_NAME
from worker import parent


@shared_task(name=TASK_NAME, ignore_result=True)
def run_job(job_id: str) -> None:
    """Make an attempt at a job in this child process."""
    from worker.context import child_runner

    child_runner().run(job_id)


@signals.task_failure.connect(sender=run_job)
def child_failed(exception: BaseException, args: Sequence[str], **_: Any) -> None:
    """Tells the database at once what the lease would only show when it runs out."""
    if isinstance(exception, WorkerLostError):
        parent.child_lost(args[0])
    elif isinstance(exception, TimeLimitExceeded):
        parent.child_hung(args[0], exception.args[0])
