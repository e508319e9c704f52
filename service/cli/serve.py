"""Run the whole service on this machine: API, dashboard, broker and workers."""

from __future__ import annotations

import argparse

from service.cli.common import add_data_argument, add_device_argument, add_listening_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_listening_arguments(parser)
    add_data_argument(parser)
    parser.add_argument("--workers", type=_count, help="number of workers (one a GPU, or 1)")
    add_device_argument(parser)


def run(args: argparse.Namespace) -> int:
    from service.cli.api import refuse_open_door
    from service.observability import configure_logging
    from service.settings import load_settings
    from service.supervisor import Supervisor

    settings = load_settings(host=args.host, port=args.port, data_dir=args.data_dir)
    configure_logging(settings)
    refuse_open_door(settings)
    return Supervisor(settings, args.workers, args.device).run()


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("there must be at least 1")
    return number
