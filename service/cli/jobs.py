"""List the jobs of a service."""

from __future__ import annotations

import argparse
from itertools import islice
from typing import TYPE_CHECKING

from service.cli.common import add_service_arguments, with_client

if TYPE_CHECKING:
    from service.client import Client


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--status",
        action="append",
        choices=("queued", "running", "succeeded", "failed", "cancelled"),
        help="only these (repeatable)",
    )
    parser.add_argument("--label", help="exactly this label")
    parser.add_argument("--limit", type=int, default=20, help="how many, newest first (20)")
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    def action(client: Client) -> int:
        import json

        for job in islice(client.jobs(status=args.status, label=args.label), args.limit):
            if args.json:
                print(json.dumps(job.raw))
                continue
            done = f"{job.fraction:4.0%}" if job.status == "running" else "    "
            name = job.label or job.raw["scan"]["name"]
            note = f"  {job.error_code}" if job.error_code else ""
            print(f"{job.id}  {job.status:9} {done}  {name}{note}")
        return 0

    return with_client(args, action)
