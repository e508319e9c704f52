"""Submit a scan to a service, and wait for the mesh if asked to."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from service.cli.common import (
    add_service_arguments,
    add_set_argument,
    artifact_for,
    check_writable,
    parse_settings,
    print_parameters,
    with_client,
)
from visco_core.errors import InputError

if TYPE_CHECKING:
    from service.client import Client, Job


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scan", type=Path, help="PLY, XYZ, PTS, OBJ, STL, PCD, LAS, E57 or NPZ")
    parser.add_argument("--wait", action="store_true", help="wait until the job has ended")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        action="append",
        default=[],
        help="file to write: .glb, .ply, .png, .json or .txt (repeatable); waits",
    )
    parser.add_argument("--label", help="a name for the job")
    add_set_argument(parser)
    add_service_arguments(parser)


def run(args: argparse.Namespace) -> int:
    if "help" in args.set:
        print_parameters()
        return 0
    if not args.scan.is_file():
        raise InputError("unreadable_file", f"{args.scan} is not a file; check the path.")
    names = {output: artifact_for(output) for output in args.output}
    for output in names:
        check_writable(output)
    params = parse_settings(args.set)
    if args.label:
        params["label"] = args.label
    if names:
        params["outputs"] = sorted({*params.get("outputs", ()), *names.values()})

    def action(client: Client) -> int:
        job = client.submit(args.scan, **params)
        print(job.id, flush=True)
        if args.wait or names:
            try:
                done = _wait(client, job.id)
            except KeyboardInterrupt:
                print(f"visco: the job goes on; `visco cancel {job.id}` ends it", file=sys.stderr)
                raise
            _tell(done)
            for output, name in names.items():
                client.download(job.id, name, output)
        return 0

    return with_client(args, action)


def _tell(job: Job) -> None:
    """What came out other than it was asked for."""
    result = job.raw["result"]
    sentences = list(result["notes"])
    if result["outcome"]["code"] != "complete":
        sentences.append(result["outcome"]["message"])
    for sentence in sentences:
        print(f"visco: {sentence}", file=sys.stderr)


def _wait(client: Client, job_id: str) -> Job:
    """With a bar on a terminal, silently elsewhere."""
    if not sys.stderr.isatty():
        return client.wait(job_id)
    from rich.console import Console
    from rich.progress import Progress

    with ExitStack() as stack:
        bar = stack.enter_context(Progress(console=Console(stderr=True), transient=True))
        shown = bar.add_task("queued", total=1.0)

        def show(job: Job) -> None:
            progress = job.raw["progress"] or {}
            phase = progress.get("phase", job.status)
            resolution = progress.get("resolution")
            text = f"{phase} {resolution}" if resolution else phase
            bar.update(shown, completed=job.fraction, description=text)

        return client.wait(job_id, show)
