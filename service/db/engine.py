"""Sessions and transactions, the same for SQLite and PostgreSQL."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, func, select
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session

_BUSY_SECONDS = 15
_WRITES = "visco_writes"


class Transaction:
    """One unit of work: a session, and what is to happen once it is committed."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self._callbacks: list[Callable[[], object]] = []

    def after_commit(self, callback: Callable[[], object]) -> None:
        """Run ``callback`` after the commit; not at all when the transaction fails."""
        self._callbacks.append(callback)

    def _committed(self) -> None:
        for callback in self._callbacks:
            callback()


def hold(session: Session, name: str) -> None:
    """Let transactions that name the same thing pass one after the other.

    PostgreSQL counts what other transactions are about to add as not there. SQLite lets writers
    pass one at a time in any case.
    """
    if session.get_bind().dialect.name == "postgresql":
        number = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], signed=True)
        session.execute(select(func.pg_advisory_xact_lock(number)))


class Database:
    """The engine of one process. Sessions are short; nothing is shared between threads."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.engine = _sqlite(url) if url.startswith("sqlite") else _server(url)
        self._writer = self.engine.execution_options(**{_WRITES: True})

    @contextmanager
    def read(self) -> Iterator[Session]:
        """A session over one consistent view; nothing in it may be changed."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def transaction(self) -> Iterator[Transaction]:
        """A session that commits at the end, or rolls back when the block raises.

        On SQLite the write lock is taken at the start: a read that later turns into a write
        could not wait for another writer and would fail at once.
        """
        with Session(self._writer, expire_on_commit=False) as session:
            unit = Transaction(session)
            with session.begin():
                yield unit
        unit._committed()

    def dispose(self) -> None:
        self.engine.dispose()


def _server(url: str) -> Engine:
    parsed = make_url(url)
    if parsed.drivername in ("postgres", "postgresql"):
        parsed = parsed.set(drivername="postgresql+psycopg")
    return create_engine(parsed, pool_pre_ping=True, pool_size=10, max_overflow=20)


def _sqlite(url: str) -> Engine:
    name = make_url(url).database
    if name:
        Path(name).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    engine = create_engine(
        url, connect_args={"timeout": _BUSY_SECONDS}, pool_size=10, max_overflow=20
    )

    @event.listens_for(engine, "connect")
    def configure(connection: Any, _record: Any) -> None:
        # Transactions are begun below; the driver's own idea of when to begin is switched off.
        connection.isolation_level = None
        cursor = connection.cursor()
        cursor.execute("PRAGMA journal_mode = WAL")
        cursor.execute("PRAGMA synchronous = FULL")
        cursor.execute("PRAGMA foreign_keys = ON")
        cursor.execute(f"PRAGMA busy_timeout = {_BUSY_SECONDS * 1000}")
        cursor.close()

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        writes = connection.get_execution_options().get(_WRITES)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine
