"""Run the whole service on this machine: API, dashboard, broker and workers."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--host", help="address to listen on (127.0.0.1)")
    parser.add_argument("--port", type=int, help="port to listen on (8000)")
    parser.add_argument("--data-dir", type=Path, help="folder of database, scans and results")
    parser.add_argument("--workers", type=int, help="number of workers (one a GPU, or 1)")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")


def run(args: argparse.Namespace) -> int:
    from service.cli.api import refuse_open_door
    from service.observability import configure_logging
    from service.settings import load_settings
    from service.supervisor import CannotServe, Supervisor

    settings = load_settings(host=args.host, port=args.port, data_dir=args.data_dir)
    configure_logging(settings)
    if refuse_open_door(settings):
        return 2
    try:
        return Supervisor(settings, args.workers, args.device).run()
    except CannotServe as error:
        print(error, file=sys.stderr)
        return 2
