"""Download what a job has left."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from service.cli.common import add_service_arguments, artifact_for, with_client

if TYPE_CHECKING:
    from service.client import Client


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(),
        help="file to write, or a folder for everything (the current one)",
    )
    parser.add_argument("--name", help="which artifact; told by the file's ending if left out")
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    def action(client: Client) -> int:
        output: Path = args.output
        if output.is_dir():
            names = [args.name] if args.name else list(client.get(args.id).artifacts)
            for name in names:
                print(client.download(args.id, name, output / name))
            return 0
        client.download(args.id, args.name or artifact_for(output), output)
        return 0

    return with_client(args, action)
