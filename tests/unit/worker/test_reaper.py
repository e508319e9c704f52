"""Finding lost attempts and forgotten messages."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from servicekit import running_broker
from sqlalchemy import update

from service.db import utc_now
from service.jobs.model import Job
from service.jobs.reaper import Reaper

if TYPE_CHECKING:
    from conftest import Bench


def test_an_attempt_without_heartbeat_is_lost_and_its_job_queued(bench: Bench) -> None:
    job = bench.submit()
    reaper = Reaper(bench.database, bench.bell, bench.settings)
    bench.change(lambda jobs: jobs.claim(job.id, "gone", "cpu", timedelta(seconds=-1), 0))
    assert reaper.reap_lost() == [job.id]
    assert reaper.reap_lost() == []
    assert bench.load(job).status == "queued"


def test_an_attempt_with_a_lease_is_left_alone(bench: Bench) -> None:
    job = bench.submit()
    bench.change(lambda jobs: jobs.claim(job.id, "there", "cpu", timedelta(seconds=60), 0))
    reaper = Reaper(bench.database, bench.bell, bench.settings)
    assert reaper.reap_lost() == []
    assert not reaper.lose(job.id, attempt=2)


def test_jobs_are_enqueued_again_only_while_their_queue_is_empty(bench: Bench) -> None:
    reaper = Reaper(bench.database, bench.bell, bench.settings)
    with running_broker(bench.settings):
        fresh = bench.submit()
        assert reaper.enqueue_forgotten() == [fresh.id]
        assert bench.bell.waiting("cpu", 1) == 1
        with bench.database.transaction() as unit:
            unit.session.execute(update(Job).values(enqueued_at=utc_now() - timedelta(minutes=1)))
        assert reaper.enqueue_forgotten() == []
        bench.bell.redis.flushall()
        assert reaper.enqueue_forgotten() == [fresh.id]
        assert reaper.enqueue_forgotten() == []


def test_a_job_over_its_owners_quota_is_announced_again_once_there_is_room(bench: Bench) -> None:
    settings = bench.settings.model_copy(update={"quota_running": 1})
    reaper = Reaper(bench.database, bench.bell, settings)
    first, second = bench.submit(), bench.submit()
    lease = timedelta(seconds=60)
    with running_broker(settings):
        reaper.enqueue_forgotten()
        for job in (first, second):
            bench.change(lambda jobs, job=job: jobs.claim(job.id, "w", "cpu", lease, 1))
        assert [bench.load(job).status for job in (first, second)] == ["running", "queued"]
        assert reaper.enqueue_forgotten() == []
        bench.change(lambda jobs: jobs.succeed(first.id, 1, {}))
        assert bench.bell.waiting("cpu", 1) > 0, "others keep the queue from being empty"
        assert reaper.enqueue_forgotten() == [second.id]


def test_a_broker_that_is_away_costs_nothing_but_patience(bench: Bench) -> None:
    job = bench.submit()
    reaper = Reaper(bench.database, bench.bell, bench.settings)
    assert reaper.enqueue_forgotten() == []
    assert bench.load(job).enqueued_at is None
