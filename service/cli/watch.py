"""Submit every new scan of a folder, and put the results beside it."""

from __future__ import annotations

import argparse
import logging
import signal
import time
from pathlib import Path

from service.cli.common import (
    add_service_arguments,
    add_set_argument,
    parse_settings,
    print_parameters,
)
from visco_core.errors import InputError

log = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="where scans appear")
    parser.add_argument("--interval", type=float, default=2.0, help="seconds between looks (2)")
    parser.add_argument(
        "--settle", type=float, default=2.0, help="seconds that a file must be unchanged (2)"
    )
    add_set_argument(parser)
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    from service.client import Client, ClientError
    from service.client.watch import FolderWatch
    from service.observability import configure_logging
    from service.settings import load_settings

    if "help" in args.set:
        print_parameters()
        return 0
    if not args.folder.is_dir():
        raise InputError("no_folder", f"{args.folder} is not a folder; make it first.")
    configure_logging(load_settings())
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    params = parse_settings(args.set)
    try:
        with (
            Client(args.url, args.key) as client,
            FolderWatch(args.folder, client, params, args.settle) as watch,
        ):
            log.info("Watching %s for scans; Ctrl-C ends it", args.folder)
            while True:
                watch.look()
                time.sleep(args.interval)
    except KeyboardInterrupt:
        # What has been done is written down at every step: no moment is a wrong one.
        return 0
    except ClientError as error:
        raise InputError("cannot_watch", str(error)) from error
