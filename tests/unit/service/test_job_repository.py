"""The life of a job, as the database keeps it."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

import pytest
from servicekit import add_job

from service.db import Database, utc_now
from service.jobs.model import Attempt, Event, Job
from service.jobs.repository import JobRepository, LeaseLost
from service.jobs.state import TERMINAL, TRANSITIONS, IllegalTransition, check_transition
from service.webhooks.model import Delivery

LEASE = timedelta(seconds=10)


def apply(database: Database, change: Callable[[JobRepository], object]) -> object:
    with database.transaction() as unit:
        return change(JobRepository(unit.session))


def claim(database: Database, job: Job, quota: int = 0) -> Job | None:
    return apply(database, lambda jobs: jobs.claim(job.id, "w1", "cpu", LEASE, quota))  # type: ignore[return-value]


def load(database: Database, job: Job) -> Job:
    with database.read() as session:
        return session.get_one(Job, job.id)


def event_types(database: Database, job: Job) -> list[str]:
    with database.read() as session:
        events = session.query(Event).where(Event.job_id == job.id).order_by(Event.sequence).all()
    assert [event.sequence for event in events] == list(range(1, len(events) + 1))
    return [event.type for event in events]


def test_terminal_states_have_no_way_out_and_all_others_have_one() -> None:
    assert {state for state, ways in TRANSITIONS.items() if not ways} == TERMINAL


def test_a_step_outside_the_table_is_refused() -> None:
    with pytest.raises(IllegalTransition):
        check_transition("succeeded", "running")


def test_only_the_first_of_two_claims_gets_the_job(database: Database) -> None:
    job = add_job(database)
    first, second = claim(database, job), claim(database, job)
    assert first is not None
    assert first.attempt == 1
    assert second is None


def test_a_full_quota_of_running_jobs_leaves_the_next_one_queued(database: Database) -> None:
    first, second, other = add_job(database), add_job(database), add_job(database, owner="other")
    assert claim(database, first, quota=1) is not None
    assert claim(database, second, quota=1) is None
    assert claim(database, other, quota=1) is not None
    assert load(database, second).status == "queued"


def test_an_attempt_that_lost_its_lease_can_store_nothing(database: Database) -> None:
    job = add_job(database)
    claim(database, job)
    apply(database, lambda jobs: jobs.lose(jobs.held(job.id, 1), 3))
    claim(database, job)
    before = load(database, job).last_sequence
    for change in (
        lambda jobs: jobs.progress(job.id, 1, {"fraction": 0.5}),
        lambda jobs: jobs.note(job.id, 1, "level", {}),
        lambda jobs: jobs.succeed(job.id, 1, {}),
        lambda jobs: jobs.fail(job.id, 1, "x", "y"),
        lambda jobs: jobs.stop(job.id, 1),
        lambda jobs: jobs.renew(job.id, 1, LEASE),
    ):
        with pytest.raises(LeaseLost):
            apply(database, change)
    after = load(database, job)
    assert (after.status, after.attempt, after.last_sequence) == ("running", 2, before)


def test_a_lost_job_is_queued_again_and_fails_after_the_third_loss(database: Database) -> None:
    job = add_job(database)
    for attempt in (1, 2, 3):
        claim(database, job)
        apply(database, lambda jobs, n=attempt: jobs.lose(jobs.held(job.id, n), 3))
    lost = load(database, job)
    assert (lost.status, lost.error_code) == ("failed", "worker_lost")
    assert event_types(database, job) == [
        "queued", "started", "requeued", "started", "requeued", "started", "failed",
    ]  # fmt: skip


def test_giving_a_job_back_does_not_count_as_a_loss(database: Database) -> None:
    job = add_job(database)
    for attempt in (1, 2, 3, 4):
        claim(database, job)
        apply(database, lambda jobs, n=attempt: jobs.stop(job.id, n))
    assert load(database, job).status == "queued"
    assert load(database, job).lost_attempts == 0


def test_a_queued_job_is_cancelled_at_once(database: Database) -> None:
    job = add_job(database)
    apply(database, lambda jobs: jobs.cancel(jobs.lock(job.id)))
    assert load(database, job).status == "cancelled"
    assert claim(database, job) is None


def test_a_running_job_is_cancelled_when_its_attempt_obeys(database: Database) -> None:
    job = add_job(database)
    claim(database, job)
    apply(database, lambda jobs: jobs.cancel(jobs.lock(job.id)))
    assert (load(database, job).status, load(database, job).cancel_requested) == ("running", True)
    apply(database, lambda jobs: jobs.stop(job.id, 1))
    assert load(database, job).status == "cancelled"
    assert event_types(database, job) == ["queued", "started", "cancel_requested", "cancelled"]


def test_losing_the_worker_of_a_cancelled_job_ends_it(database: Database) -> None:
    job = add_job(database)
    claim(database, job)
    apply(database, lambda jobs: jobs.cancel(jobs.lock(job.id)))
    apply(database, lambda jobs: jobs.lose(jobs.held(job.id, 1), 3))
    assert load(database, job).status == "cancelled"


def test_expired_lists_only_leases_that_ran_out(database: Database) -> None:
    job = add_job(database)
    claim(database, job)
    assert apply(database, lambda jobs: jobs.expired(utc_now())) == []
    later = utc_now() + LEASE + timedelta(seconds=1)
    assert apply(database, lambda jobs: jobs.expired(later)) == [job.id]
    with database.transaction() as unit:
        JobRepository(unit.session).renew(job.id, 1, 3 * LEASE)
    assert apply(database, lambda jobs: jobs.expired(later)) == []


def test_every_end_of_a_job_with_a_callback_leaves_one_delivery(database: Database) -> None:
    job = add_job(database, callback_url="https://example.com/hook", label="part 7")
    claim(database, job)
    apply(database, lambda jobs: jobs.succeed(job.id, 1, {"vertices": 3}))
    with database.read() as session:
        (delivery,) = session.query(Delivery).all()
        attempt = session.get_one(Attempt, (job.id, 1))
    assert delivery.payload["type"] == "job.succeeded"
    assert delivery.payload["data"]["label"] == "part 7"
    assert attempt.outcome == "succeeded"


def test_a_failed_transaction_rings_nobody(database: Database) -> None:
    rung: list[int] = []

    def fail() -> None:
        with database.transaction() as unit:
            unit.after_commit(lambda: rung.append(1))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert rung == []
