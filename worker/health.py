"""``python -m worker.health``: whether a worker on this machine was seen lately, as exit code."""

from __future__ import annotations

import socket
import sys
from datetime import timedelta

from service.db import Database, utc_now
from service.jobs.queries import live_workers
from service.settings import Settings, load_settings


def is_alive(settings: Settings) -> bool:
    """Whether the database knows a live worker with this machine's name."""
    database = Database(settings.sqlalchemy_url)
    since = utc_now() - timedelta(seconds=settings.lease_seconds)
    try:
        with database.read() as session:
            workers = live_workers(session, since)
    finally:
        database.dispose()
    return any(worker.id.startswith(f"{socket.gethostname()}:") for worker in workers)


if __name__ == "__main__":
    sys.exit(0 if is_alive(load_settings()) else 1)
