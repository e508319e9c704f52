"""Run the API alone, for many machines."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from service.settings import Settings

_DRAIN_SECONDS = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", help="address to listen on (127.0.0.1)")
    parser.add_argument("--port", type=int, help="port to listen on (8000)")
    parser.add_argument("--data-dir", type=Path, help="folder of database, scans and results")


def run(args: argparse.Namespace) -> int:
    import uvicorn

    from service.db import Database
    from service.db.migrate import migrate
    from service.main import create_app
    from service.observability import configure_logging
    from service.settings import load_settings

    settings = load_settings(host=args.host, port=args.port, data_dir=args.data_dir)
    configure_logging(settings)
    database = Database(settings.sqlalchemy_url)
    migrate(database)
    database.dispose()
    if refuse_open_door(settings):
        return 2
    config = uvicorn.Config(
        create_app(settings),
        host=settings.host,
        port=settings.port,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=_DRAIN_SECONDS,
    )
    uvicorn.Server(config).run()
    return 0


def refuse_open_door(settings: Settings) -> bool:
    """Without keys the service is for this machine alone. True when it must not start."""
    if settings.listens_on_loopback or settings.require_keys is False:
        return False
    from service.auth.service import KeyService
    from service.db import Database
    from service.db.migrate import migrate

    database = Database(settings.sqlalchemy_url)
    migrate(database)
    has_keys = KeyService(database).any_active()
    database.dispose()
    if not has_keys:
        print(
            f"Make an API key with `visco keys create` before listening on {settings.host}; "
            "without keys only 127.0.0.1 is served.",
            file=sys.stderr,
        )
    return not has_keys
