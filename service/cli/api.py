"""Run the API alone, for many machines."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from service.cli.common import add_data_argument, add_listening_arguments
from visco_core.errors import InputError

if TYPE_CHECKING:
    from service.settings import Settings

_DRAIN_SECONDS = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_listening_arguments(parser)
    add_data_argument(parser)


def run(args: argparse.Namespace) -> int:
    import uvicorn

    from service.db.migrate import open_database
    from service.main import create_app
    from service.observability import configure_logging
    from service.settings import load_settings

    settings = load_settings(host=args.host, port=args.port, data_dir=args.data_dir)
    configure_logging(settings)
    open_database(settings.sqlalchemy_url).dispose()
    refuse_open_door(settings)
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


def refuse_open_door(settings: Settings) -> None:
    """Without keys the service is for this machine alone. Raises InputError (``no_keys``)."""
    if settings.listens_on_loopback or settings.require_keys is False:
        return
    from service.auth.service import KeyService
    from service.db.migrate import open_database

    database = open_database(settings.sqlalchemy_url)
    has_keys = KeyService(database).any_active()
    database.dispose()
    if has_keys:
        return
    raise InputError(
        "no_keys",
        f"Make an API key with `visco keys create` before listening on {settings.host}; "
        "without keys only 127.0.0.1 is served.",
    )
