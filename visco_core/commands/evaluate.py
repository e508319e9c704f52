"""Measure a mesh against the truth by the Surface Reconstruction Benchmark's metrics, as JSON."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mesh", type=Path, help="the mesh to judge")
    parser.add_argument("--gt", type=Path, required=True, help="true surface: mesh or points")
    parser.add_argument("--scan", type=Path, help="the scan, for scan → mesh distances")
    parser.add_argument("--samples", type=int, default=1_000_000, help="surface samples (1000000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the samples (0)")


def run(args: argparse.Namespace) -> int:
    from visco_core.errors import InputError
    from visco_core.io import read_mesh, read_points
    from visco_core.metrics import evaluate

    if args.samples < 1:
        raise InputError("invalid_option", "--samples must be at least 1.")
    mesh = read_mesh(args.mesh)
    try:
        truth = read_mesh(args.gt)
    except InputError as error:
        if error.code != "not_a_mesh":
            raise
        truth = read_points(args.gt)
    found = evaluate(
        mesh,
        truth,
        None if args.scan is None else read_points(args.scan),
        samples=args.samples,
        seed=args.seed,
    )
    print(json.dumps(found, indent=2))
    return 0
