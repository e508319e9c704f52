"""Scans with a ground truth: ``python -m tests.benchmarks.srb --data DIR``.

DIR holds ``scans/NAME.ply`` and, of each, any of ``gt/NAME_gt_mesh.ply``,
``gt/NAME_gt_points*.ply`` and ``gt/NAME_occ_points.npz``; without DIR, the scans are the gallery's.
Distances are in the scan's own units.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.benchmarks.contest import (
    Case,
    Score,
    add_contest_arguments,
    compete,
    print_problems,
    write_report,
)
from tests.benchmarks.gallery_scans import write_gallery
from tests.benchmarks.peers import add_method_arguments, methods_of
from tests.benchmarks.tables import markdown_table, rounded
from visco_core.io import read_mesh, read_points
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

POINTS_HEADER = (
    *("scan", "method", "d_C", "d_H", "gt to mesh", "max", "scan to mesh", "max"),
    *("IoU", "seconds", "ratio", "MiB"),
)
TRIANGLES_HEADER = (
    *("scan", "method", "gt to mesh", "max", "scan to mesh", "max", "F-score", "normals"),
    *("triangles", "components", "whole"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_arguments(parser)
    add_method_arguments(parser)
    add_contest_arguments(parser)
    arguments = parser.parse_args()
    methods = methods_of(arguments)
    scores = list(compete(data_cases(arguments), methods, arguments))
    made = [score for score in scores if score.metrics is not None]
    times = {score.case: score.seconds for score in made if score.method == methods[0].name}
    print(markdown_table(POINTS_HEADER, [_points_row(score, times) for score in made]))
    print("\nPoint to triangle:\n")
    print(markdown_table(TRIANGLES_HEADER, [_triangles_row(score) for score in made]))
    print_problems(scores)
    if arguments.json:
        write_report(arguments.json, arguments, scores)


def _points_row(score: Score, baseline_seconds: dict[str, float]) -> list[str]:
    """The benchmark's protocol, and the cost; ``ratio``: time against the baseline's."""
    metrics = score.metrics or {}
    sides, baseline = metrics["one_sided"], baseline_seconds.get(score.case)
    return [
        score.case,
        score.method,
        rounded(metrics["d_C"], 3),
        rounded(metrics["d_H"], 2),
        *mean_and_max(sides["gt_to_mesh"]),
        *mean_and_max(sides["scan_to_mesh"]),
        rounded(score.iou, 4),
        rounded(score.seconds, 2),
        rounded(score.seconds / baseline if baseline else None, 2),
        rounded(score.peak_bytes / 2**20, 0),
    ]


def _triangles_row(score: Score) -> list[str]:
    metrics, health = score.metrics or {}, score.health or {}
    sides, f_score = metrics["point_to_triangle"], metrics["f_score"]
    return [
        score.case,
        score.method,
        *mean_and_max(sides["gt_to_mesh"]),
        *mean_and_max(sides["scan_to_mesh"]),
        rounded(f_score and f_score["value"], 4),
        rounded(metrics["normal_consistency"], 4),
        str(health["faces"]),
        str(health["components"]),
        "yes" if health["watertight"] and health["outward"] else "no",
    ]


def mean_and_max(deviation: dict[str, float]) -> tuple[str, str]:
    """The two cells of a one-sided distance."""
    return rounded(deviation["mean"], 3), rounded(deviation["max"], 2)


def add_data_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data", type=Path, help="folder with scans/ and gt/; without it, scans of the gallery"
    )
    parser.add_argument("--scans", default="", help="comma-separated names, all by default")


def data_cases(arguments: argparse.Namespace) -> Iterator[Case]:
    """The scans that ``add_data_arguments`` asks for, with what is known of their surfaces."""
    data, names = arguments.data, arguments.scans
    if data is None:
        data = write_gallery(arguments.work / "gallery")
    chosen = set(filter(None, names.split(",")))
    scans = [
        path
        for path in sorted((data / "scans").iterdir())
        if path.is_file() and (not chosen or path.stem in chosen)
    ]
    if not scans:
        raise SystemExit(f"no scans in {data / 'scans'}" + (f" among {names}" if names else ""))
    for scan in scans:
        truth, occupancy = _truth(data / "gt", scan.stem), _occupancy(data, scan.stem)
        yield Case(scan.stem, scan, truth, occupancy, from_scan=True)


def _truth(folder: Path, name: str) -> Mesh | PointCloud | None:
    for path in sorted(folder.glob(f"{name}_gt_mesh.*")):
        return read_mesh(path)
    for path in sorted(folder.glob(f"{name}_gt_points*")):
        return read_points(path)
    return None


def _occupancy(data: Path, name: str) -> tuple[np.ndarray, np.ndarray] | None:
    path = data / "gt" / f"{name}_occ_points.npz"
    if not path.is_file():
        return None
    stored = np.load(path)
    points = stored["points"].astype(np.float64)
    return points, np.unpackbits(stored["occupancies"])[: len(points)].astype(bool)


if __name__ == "__main__":
    main()
