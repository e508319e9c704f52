"""Turn one scan into a mesh, in this process: no service needed."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

from visco_core.commands.values import byte_count, option_table, option_values
from visco_core.config import ReconstructionConfig, describe_options
from visco_core.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scan", type=Path, help="PLY, XYZ, PTS, OBJ, STL, PCD, LAS, E57 or NPZ")
    parser.add_argument("-o", "--output", type=Path, required=True, help="mesh: .glb or .ply")
    parser.add_argument("--resolution", type=int, help="voxels along the longest axis (256)")
    parser.add_argument("--budget", type=float, metavar="SECONDS", help="wall-clock limit")
    parser.add_argument("--profile", choices=("fast", "paper"), help="solver (fast)")
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    parser.add_argument("--backend", choices=("auto", "reference", "native"), default="auto")
    parser.add_argument("--threads", type=int, help="CPU threads (all)")
    parser.add_argument("--max-memory", metavar="SIZE", help="memory limit, such as 4GiB")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="settings",
        help="any other option, such as lambda_v=1e-5 (repeatable; --set help lists them)",
    )
    parser.add_argument("--report", type=Path, metavar="JSON", help="write what was done")
    parser.add_argument("--preview", type=Path, metavar="PNG", help="write a picture of the mesh")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress bar")


def run(args: argparse.Namespace) -> int:
    started_at = _process_start()
    if "help" in args.settings:
        print(option_table(describe_options()))
        return 0
    config = _config(args)
    from visco_core.io import check_output, read_points, write_mesh
    from visco_core.reconstruction import reconstruct

    check_output(args.output)
    with _StopOnInterrupt() as stop, _bar(args.quiet) as bar:
        read_at = time.monotonic()
        cloud = read_points(args.scan)
        read_seconds = time.monotonic() - read_at
        result = reconstruct(
            cloud, config, on_progress=bar.show, should_stop=stop.asked, started_at=started_at
        )
        write_at = time.monotonic()
        metadata = {"resolution": result.outcome.resolution, "outcome": result.outcome.code}
        write_mesh(result.mesh, args.output, up_axis=config.up_axis, metadata=metadata)
        write_seconds = time.monotonic() - write_at
    if args.preview:
        from visco_core.preview import render_preview

        render_preview(result.mesh, args.preview, up_axis=config.up_axis)
    if args.report:
        read = {"phase": "read", "points": len(cloud), "seconds": round(read_seconds, 4)}
        write = {"phase": "write", "seconds": round(write_seconds, 4)}
        report = {
            **result.report,
            "scan": str(args.scan),
            "phases": [read, *result.report["phases"], write],
            "seconds": round(time.monotonic() - started_at, 4),
        }
        args.report.write_text(json.dumps(report, indent=2) + "\n")
    if not args.quiet:
        seconds = time.monotonic() - started_at
        triangles = len(result.mesh.faces)
        print(
            f"{args.output}: {triangles:,} triangles in {seconds:.1f} s. {result.outcome.message}"
        )
        for note in result.notes:
            print(f"visco: {note}", file=sys.stderr)
    return 0


def _config(args: argparse.Namespace) -> ReconstructionConfig:
    flags = {
        "resolution": args.resolution,
        "budget_seconds": args.budget,
        "profile": args.profile,
        "max_memory_bytes": None if args.max_memory is None else byte_count(args.max_memory),
    }
    options = option_values(args.settings)
    options |= {name: value for name, value in flags.items() if value is not None}
    if args.threads is not None and args.threads < 1:
        raise InputError("invalid_option", "--threads must be at least 1.")
    return ReconstructionConfig.from_options(
        options, device=args.device, backend=args.backend, threads=args.threads
    )


def _process_start() -> float:
    """When this process began, as a time.monotonic() value: start-up counts against the budget."""
    if sys.platform == "linux":
        # Not by psutil, which goes by the time of the boot: the kernel gives that in whole seconds.
        ticks = Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]
        age = time.clock_gettime(time.CLOCK_BOOTTIME) - int(ticks) / os.sysconf("SC_CLK_TCK")
    else:
        import psutil

        age = max(time.time() - psutil.Process().create_time(), 0.0)
    return time.monotonic() - age


class _StopOnInterrupt:
    """Turns the first Ctrl-C into a stop request, so that nothing is left half-written."""

    def __enter__(self) -> _StopOnInterrupt:
        self._asked = False
        self._previous = signal.signal(signal.SIGINT, self._ask)
        return self

    def _ask(self, *_: object) -> None:
        self._asked = True
        signal.signal(signal.SIGINT, self._previous)

    def asked(self) -> bool:
        return self._asked

    def __exit__(self, *_: object) -> None:
        signal.signal(signal.SIGINT, self._previous)


def _bar(quiet: bool):
    from visco_core.commands.progress_bar import ProgressBar

    return ProgressBar(enabled=not quiet and sys.stderr.isatty())
