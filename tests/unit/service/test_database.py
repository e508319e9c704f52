"""The schema, and what a transaction promises."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from servicekit import add_job, make_settings, write_events_at_once

from service.db import Database, new_id, utc_now
from service.db.migrate import migrate
from service.db.tables import metadata
from service.jobs.model import Job


def test_the_migrations_make_exactly_the_tables_of_the_models(database: Database) -> None:
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_several_processes_may_migrate_at_once(tmp_path: Path) -> None:
    url = make_settings(tmp_path).sqlalchemy_url

    def start(_: int) -> None:
        database = Database(url)
        migrate(database)
        database.dispose()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(start, range(4)))


def test_ids_sort_by_age_and_never_repeat() -> None:
    ids = [new_id() for _ in range(1000)]
    assert len(set(ids)) == 1000
    assert [i[:9] for i in ids] == sorted(i[:9] for i in ids)


def test_times_come_back_aware_and_in_utc(database: Database) -> None:
    before = utc_now()
    job = add_job(database)
    with database.read() as session:
        created = session.get_one(Job, job.id).created_at
    assert created.utcoffset() is not None
    assert before <= created <= utc_now()


def test_many_writers_number_the_events_without_gap_or_repetition(database: Database) -> None:
    assert write_events_at_once(database) == list(range(1, 42))
