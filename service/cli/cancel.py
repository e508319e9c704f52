"""Cancel a job."""

from __future__ import annotations

import argparse

from service.cli.common import add_service_arguments, with_client


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", help="the job's id, as `visco jobs` shows it")
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    return with_client(args, lambda client: 0 if client.cancel(args.id) else 1)
