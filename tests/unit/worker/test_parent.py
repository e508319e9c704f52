"""What the parent process writes down about a child that is gone."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from typing import TYPE_CHECKING

import pytest
from billiard.exceptions import TimeLimitExceeded, WorkerLostError
from celery import signals

from service.jobs.model import Job
from worker import parent as parent_module
from worker.identity import WorkerIdentity
from worker.parent import Parent
from worker.task import run_job

if TYPE_CHECKING:
    from conftest import Bench


@pytest.fixture
def running(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[Job]:
    """A job that a child of this process's parent solves."""
    parent = Parent(bench.settings, WorkerIdentity("ours", "cpu"), [])
    monkeypatch.setattr(parent_module, "_parent", parent)
    job = bench.submit()
    bench.change(lambda jobs: jobs.claim(job.id, "ours", "cpu", timedelta(hours=1), 0))
    yield job
    parent.bell.close()
    parent.database.dispose()


def child_ended_with(exception: Exception, job: Job) -> None:
    """What Celery says in the parent."""
    signals.task_failure.send(sender=run_job, exception=exception, args=[job.id])


def test_the_job_of_a_lost_child_is_queued_at_once(bench: Bench, running: Job) -> None:
    child_ended_with(WorkerLostError("signal 9"), running)
    assert (bench.load(running).status, bench.load(running).lost_attempts) == ("queued", 1)


def test_the_job_of_a_child_that_had_to_be_killed_fails(bench: Bench, running: Job) -> None:
    child_ended_with(TimeLimitExceeded(75.0), running)
    assert bench.load(running).error_code == "hard_limit"
    child_ended_with(TimeLimitExceeded(75.0), running)
    assert "75 s" in (bench.load(running).error_detail or "")


def test_an_attempt_of_another_worker_is_none_of_its_business(bench: Bench, running: Job) -> None:
    bench.change(lambda jobs: jobs.lose(jobs.held(running.id, 1), 3))
    bench.change(lambda jobs: jobs.claim(running.id, "theirs", "cpu", timedelta(hours=1), 0))
    child_ended_with(WorkerLostError("signal 9"), running)
    assert (bench.load(running).status, bench.load(running).attempt) == ("running", 2)
