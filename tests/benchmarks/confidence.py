"""What a vertex's confidence is worth: ``python -m tests.benchmarks.confidence --data DIR``.

The vertices of each mesh are sorted by their confidence and split into tenths; each has a mean
confidence and a mean distance to the true surface, in thousandths of the diagonal. ``--meshes``
adds scans of exact surfaces, with noise and with holes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.benchmarks.srb import add_data_arguments, data_cases
from tests.benchmarks.surfaces import load_surface
from tests.benchmarks.tables import markdown_table
from visco_core.config import ReconstructionConfig
from visco_core.gallery import uniform_scan
from visco_core.io import read_points
from visco_core.metrics import point_to_mesh_distance
from visco_core.pointcloud import PointCloud
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh

POINTS, NOISE, HOLES, HOLE_RADIUS = 100_000, 0.001, 8, 0.05
"""Of the scans of ``--meshes``; lengths are fractions of the diagonal."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_arguments(parser)
    parser.add_argument("--meshes", type=Path, help="folder of watertight meshes")
    parser.add_argument("--surfaces", default="armadillo,fandisk,fertility")
    parser.add_argument("--resolution", type=int, default=256)
    parser.add_argument("--work", type=Path, default=Path("out/bench"), help="keeps the scans")
    arguments = parser.parse_args()
    rows = []
    for name, cloud, truth in _scans(arguments):
        mesh = reconstruct(cloud, ReconstructionConfig(resolution=arguments.resolution)).mesh
        confidence, error = tenths(mesh, truth)
        rows.append([name, "confidence", *(f"{value:.2f}" for value in confidence)])
        rows.append([name, "error", *(f"{value:.2f}" for value in error)])
    numbers = [str(tenth) for tenth in range(1, 11)]
    print(markdown_table(["scan", "mean of each tenth", *numbers], rows))


def tenths(mesh: Mesh, truth: Mesh) -> tuple[list[float], list[float]]:
    """Mean confidence and mean error of each tenth of the vertices, the least confident first."""
    confidence = mesh.attributes["confidence"]
    diagonal = float(np.linalg.norm(np.ptp(truth.vertices, axis=0)))
    error = 1000 * point_to_mesh_distance(mesh.vertices, truth) / diagonal
    parts = np.array_split(np.argsort(confidence, kind="stable"), 10)
    return (
        [float(confidence[part].mean()) for part in parts],
        [float(error[part].mean()) for part in parts],
    )


def _scans(arguments: argparse.Namespace) -> Iterator[tuple[str, PointCloud, Mesh]]:
    for case in data_cases(arguments):
        if isinstance(case.truth, Mesh):
            yield case.name, read_points(case.scan), case.truth
    if arguments.meshes is not None:
        for name in arguments.surfaces.split(","):
            truth = load_surface(name, arguments.meshes)
            yield name, _with_holes(truth), truth


def _with_holes(truth: Mesh) -> PointCloud:
    cloud = uniform_scan(truth, POINTS, noise=NOISE, normal_noise=10)
    centers = np.random.default_rng(0).choice(truth.vertices, HOLES, replace=False)
    radius = HOLE_RADIUS * np.linalg.norm(np.ptp(truth.vertices, axis=0))
    away = np.linalg.norm(cloud.points[:, None] - centers, axis=2) > radius
    return cloud.select(away.all(1))


if __name__ == "__main__":
    main()
