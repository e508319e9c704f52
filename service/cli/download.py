"""Download what a job has left."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from service.cli.common import add_service_arguments, artifact_for, check_writable, with_client

if TYPE_CHECKING:
    from service.client import Client


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", help="the job's id, as `visco jobs` shows it")
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
    output: Path = args.output
    if output.is_dir():
        return with_client(args, lambda client: _fill(client, args.id, args.name, output))
    check_writable(output)
    name = args.name or artifact_for(output)
    return with_client(args, lambda client: _show(client.download(args.id, name, output)))


def _fill(client: Client, job_id: str, name: str | None, folder: Path) -> int:
    for each in [name] if name else client.get(job_id).artifacts:
        _show(client.download(job_id, each, folder / each))
    return 0


def _show(written: Path) -> int:
    print(written)
    return 0
