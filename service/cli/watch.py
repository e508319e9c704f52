"""Submit every new scan of a folder, and put the results beside it."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from pathlib import Path

from service.cli.common import add_service_arguments, add_set_argument, parse_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path)
    parser.add_argument("--interval", type=float, default=2.0, help="seconds between looks (2)")
    parser.add_argument(
        "--settle", type=float, default=2.0, help="seconds that a file must be unchanged (2)"
    )
    add_set_argument(parser)
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    from service.client import Client
    from service.client.watch import AlreadyWatched, FolderWatch
    from service.observability import configure_logging
    from service.settings import load_settings

    if not args.folder.is_dir():
        print(f"{args.folder} is not a folder; make it first.", file=sys.stderr)
        return 2
    configure_logging(load_settings())
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    params = parse_settings(args.set)
    try:
        with (
            Client(args.url, args.key) as client,
            FolderWatch(args.folder, client, params, args.settle) as watch,
        ):
            while not ended.is_set():
                watch.look()
                ended.wait(args.interval)
    except AlreadyWatched as error:
        print(error, file=sys.stderr)
        return 2
    return 0
