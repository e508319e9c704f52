"""Bringing a database to the schema of this version."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import OperationalError

from service.db.engine import Database
from visco_core.errors import ResourceError

_LOCK_NUMBER = 0x564953434F
MIGRATIONS = Path(__file__).parent / "migrations"


def open_database(url: str) -> Database:
    """The database with the schema of this version.

    Raises ResourceError (``database_unusable``).
    """
    try:
        database = Database(url)
        migrate(database)
    except (OSError, OperationalError) as error:
        reason = str(getattr(error, "orig", error)).strip().splitlines()[0]
        raise ResourceError(
            "database_unusable",
            f"The database cannot be used ({reason}); check VISCO_DATABASE_URL and VISCO_DATA_DIR.",
        ) from error
    return database


def migrate(database: Database) -> None:
    """Apply what is missing. Several processes may start at once: one does it, the others wait."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    config.set_main_option("path_separator", "os")
    with _one_at_a_time(database), database.engine.connect() as connection:
        if connection.dialect.name != "sqlite":
            connection.execute(text(f"SELECT pg_advisory_lock({_LOCK_NUMBER})"))
        config.attributes["connection"] = connection
        try:
            command.upgrade(config, "head")
            connection.commit()
        finally:
            _unlock(connection)


def _unlock(connection: Connection) -> None:
    if connection.dialect.name != "sqlite":
        connection.execute(text(f"SELECT pg_advisory_unlock({_LOCK_NUMBER})"))
        connection.commit()


@contextmanager
def _one_at_a_time(database: Database) -> Iterator[None]:
    """SQLite has no advisory locks; a lock file beside the database does the same."""
    name = make_url(database.url).database
    if not database.url.startswith("sqlite") or not name:
        yield
        return
    with Path(f"{name}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
