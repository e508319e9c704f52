"""The one Celery task, and what the parent does when its child is lost."""

from __future__ import annotations

import logging
from typing import Any

from billiard.exceptions import WorkerLostError
from celery import Task, shared_task
from celery.worker.request import Request

from service.jobs.queues import TASK_NAME
from worker import parent

log = logging.getLogger(__name__)


class JobRequest(Request):
    """Tells the database at once what the lease would only show when it runs out."""

    def on_timeout(self, soft: bool, timeout: float) -> None:
        super().on_timeout(soft, timeout)
        if not soft:
            parent.child_hung(str(self.args[0]), timeout)

    def on_failure(
        self, exc_info: Any, send_failed_event: bool = True, return_ok: bool = False
    ) -> Any:
        answer = super().on_failure(exc_info, send_failed_event, return_ok)
        if isinstance(exc_info.exception, WorkerLostError):
            parent.child_lost(str(self.args[0]))
        return answer


class JobTask(Task):
    abstract = True
    Request = JobRequest


@shared_task(name=TASK_NAME, base=JobTask, ignore_result=True)
def run_job(job_id: str) -> None:
    """Make an attempt at a job in this child process."""
    from worker.context import child_runner

    child_runner().run(job_id)
