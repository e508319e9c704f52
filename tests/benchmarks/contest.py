"""Methods against each other on scans with a known truth, in one go on one machine."""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import platform
import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.peers import Method, Run, run_method
from visco_core.errors import InputError
from visco_core.io import read_mesh, read_points
from visco_core.mesh_health import mesh_health
from visco_core.metrics import evaluate, occupancy_iou
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

_PACKAGES = ("numpy", "torch", "open3d", "pymeshlab")


@dataclass(frozen=True)
class Case:
    """A scan and what is known of the surface it was taken from.

    occupancy: points (P, 3) and whether each is inside (P,); from_scan: also measure from the
    scan's points to the mesh; tags: what a table groups by.
    """

    name: str
    scan: Path
    truth: Mesh | PointCloud | None
    occupancy: tuple[np.ndarray, np.ndarray] | None = None
    from_scan: bool = False
    tags: dict[str, Any] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class Score:
    """What a method made of a case; ``metrics`` and ``health`` are None where it made no mesh.

    mesh: the path of what it wrote.
    """

    case: str
    method: str
    mesh: str
    runs: list[Run]
    metrics: dict[str, Any] | None
    health: dict[str, Any] | None
    iou: float | None
    tags: dict[str, Any]

    @property
    def seconds(self) -> float:
        return statistics.median(run.seconds for run in self.runs)

    @property
    def peak_bytes(self) -> int:
        return max(run.peak_bytes for run in self.runs)

    @property
    def problem(self) -> str:
        return next((run.problem for run in self.runs if run.problem), "")


def add_contest_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--repeats", type=int, default=1, help="runs of each; times are medians")
    parser.add_argument("--no-warm-up", action="store_true", help="count the first, cold run too")
    add_run_arguments(parser)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """What a benchmark needs that compares results and not times."""
    parser.add_argument("--samples", type=int, default=1_000_000, help="points for a surface")
    parser.add_argument("--timeout", type=float, default=1800.0, help="seconds for one run")
    parser.add_argument("--work", type=Path, default=Path("out/bench"), help="keeps the meshes")
    parser.add_argument("--json", type=Path, help="also write everything here")


def compete(
    cases: Iterable[Case], methods: Sequence[Method], arguments: argparse.Namespace
) -> Iterator[Score]:
    """Every method on every case; they take turns, so that a busy machine hurts all alike."""
    folder = arguments.work.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    warm = arguments.no_warm_up
    for case in cases:
        outs = {method.name: folder / f"{case.name}.{method.name}.ply" for method in methods}
        runs: dict[str, list[Run]] = {method.name: [] for method in methods}
        for turn in range(arguments.repeats + (not warm)):
            for method in methods if turn % 2 == 0 else reversed(methods):
                print(f"{case.name}: {method.name}", file=sys.stderr, flush=True)
                out, scan = outs[method.name], case.scan.resolve()
                run = run_method(method, scan, out, arguments.resolution, arguments.timeout)
                if warm or turn > 0:
                    runs[method.name].append(run)
        warm = True
        for method in methods:
            yield _score(case, method, runs[method.name], outs[method.name], arguments.samples)


def print_problems(scores: Iterable[Score]) -> None:
    """Which methods failed, and their last words."""
    for score in scores:
        if score.problem:
            print(f"\n{score.case}, {score.method}: {score.problem}")


def write_report(path: Path, arguments: argparse.Namespace, scores: Sequence[Score]) -> None:
    """Everything that was measured, and on what, as JSON."""
    report = {
        "machine": _machine(),
        "arguments": {name: str(value) for name, value in vars(arguments).items()},
        "scores": [dataclasses.asdict(score) for score in scores],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(report, indent=1), encoding="utf-8")


def _score(case: Case, method: Method, runs: list[Run], out: Path, samples: int) -> Score:
    metrics, health, iou = None, None, None
    try:
        mesh = read_mesh(out)
        health = mesh_health(mesh)
        truth = case.truth if case.truth is not None else read_points(case.scan)
        scan = read_points(case.scan) if case.from_scan else None
        metrics = evaluate(mesh, truth, scan, samples=samples)
        if case.occupancy is not None:
            iou = occupancy_iou(mesh, *case.occupancy)
    except InputError as error:
        if not any(run.problem for run in runs):
            runs = [dataclasses.replace(run, problem=error.detail) for run in runs]
    return Score(case.name, method.name, str(out), runs, metrics, health, iou, case.tags)


def _machine() -> dict[str, Any]:
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in _PACKAGES},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
