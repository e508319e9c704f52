"""Noise against number of points: ``python -m tests.benchmarks.synthetic --meshes DIR``.

Scans are drawn evenly from exact surfaces. The error is the mean distance to the true surface, both
ways averaged, point to triangle, in thousandths of the diagonal.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tests.benchmarks.contest import (
    Case,
    Score,
    add_contest_arguments,
    compete,
    print_problems,
    write_report,
)
from tests.benchmarks.peers import Method, add_method_arguments, methods_of
from tests.benchmarks.surfaces import load_surface
from tests.benchmarks.tables import mark_best, markdown_table
from visco_core.gallery import uniform_scan, write_scan
from visco_core.result import Mesh


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scan_arguments(parser, points="20000,200000", noise="0,0.002,0.01")
    add_method_arguments(parser)
    add_contest_arguments(parser)
    arguments = parser.parse_args()
    methods = methods_of(arguments)
    scores = list(compete(synthetic_cases(arguments), methods, arguments))
    for title, digits, pick in (
        ("Mean distance, 1/1000 of the diagonal", 3, mean_error),
        ("Largest distance, 1/1000 of the diagonal", 1, largest_error),
        ("Seconds, file to file", 2, lambda score: score.seconds),
    ):
        print(f"\n{title}\n\n{_table(scores, methods, digits, pick)}")
    print_problems(scores)
    if arguments.json:
        write_report(arguments.json, arguments, scores)


def add_scan_arguments(parser: argparse.ArgumentParser, *, points: str, noise: str) -> None:
    """What ``synthetic_cases`` reads, but for ``--work``, with these defaults."""
    parser.add_argument("--meshes", type=Path, help="folder of watertight meshes")
    parser.add_argument("--surfaces", default="armadillo,fandisk,fertility,bracket,octopus")
    parser.add_argument("--points", default=points)
    parser.add_argument("--noise", default=noise, help="std, fractions of the diagonal")


def mean_error(score: Score) -> float | None:
    """Both ways averaged, in thousandths of the diagonal."""
    return thousandths(score.metrics, score.tags["diagonal"], "mean") if score.metrics else None


def largest_error(score: Score) -> float | None:
    """The larger of both ways, in thousandths of the diagonal."""
    return thousandths(score.metrics, score.tags["diagonal"], "max") if score.metrics else None


def thousandths(metrics: dict[str, Any], diagonal: float, which: Literal["mean", "max"]) -> float:
    """The mean or largest of both ways, point to triangle, in thousandths of the diagonal."""
    sides = metrics["point_to_triangle"]
    both = [sides[side][which] for side in ("gt_to_mesh", "mesh_to_gt")]
    return 1000.0 * (max(both) if which == "max" else sum(both) / 2) / diagonal


def normal_error(noise: float) -> float:
    """Tilt in degrees of the normals that go with a noise: 6 without any, 35 at one percent."""
    return 6.0 + 29.0 * min(noise / 0.01, 1.0)


def synthetic_cases(arguments: argparse.Namespace) -> Iterator[Case]:
    """Every surface with every number of points and every noise, written as scans."""
    folder = arguments.work.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    counts = [int(text) for text in arguments.points.split(",")]
    noises = [float(text) for text in arguments.noise.split(",")]
    for name in arguments.surfaces.split(","):
        truth = load_surface(name, arguments.meshes)
        for count, noise in itertools.product(counts, noises):
            yield _case(name, truth, count, noise, folder)


def _case(name: str, truth: Mesh, count: int, noise: float, folder: Path) -> Case:
    cloud = uniform_scan(truth, count, noise=noise, normal_noise=normal_error(noise))
    label = f"{name}-{count}-{noise:g}"
    diagonal = float(np.linalg.norm(np.ptp(truth.vertices, axis=0)))
    tags = {"surface": name, "points": count, "noise": noise, "diagonal": diagonal}
    return Case(label, write_scan(cloud, folder / f"{label}.scan.ply"), truth, tags=tags)


def _table(
    scores: Sequence[Score],
    methods: Sequence[Method],
    digits: int,
    pick: Callable[[Score], float | None],
) -> str:
    rows = []
    for _, group in itertools.groupby(scores, key=lambda score: score.case):
        cells = list(group)
        tags = cells[0].tags
        key = [tags["surface"], f"{tags['points']}", f"{100.0 * tags['noise']:g} %"]
        rows.append([*key, *mark_best([pick(score) for score in cells], digits)])
    header = ["surface", "points", "noise", *(method.name for method in methods)]
    return markdown_table(header, rows)


if __name__ == "__main__":
    main()
