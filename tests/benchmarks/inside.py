"""The inside of scans without normals: ``python -m tests.benchmarks.inside --meshes DIR``.

Scans are drawn evenly from exact surfaces. Beside the share of normals on the wrong side stands the
overlap (intersection over union) of the mesh's inside with the true one, counted within 2 % of the
diagonal around the surface, and the same with the scan's own normals: what a scan as noisy allows.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np

from tests.benchmarks.surfaces import load_surface
from tests.benchmarks.tables import markdown_table
from visco_core import gallery
from visco_core.config import ReconstructionConfig
from visco_core.gallery import uniform_scan
from visco_core.metrics import is_inside, occupancy_iou, sample_surface
from visco_core.normals import estimate_normals
from visco_core.pointcloud import PointCloud
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh

PLACES, WITHIN = 100_000, 0.02
"""Where the insides are compared, and how far, in diagonals, these places are from the surface."""

NORMAL_NOISE = 6.0
"""Degrees: of the own normals."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", type=Path, help="folder of watertight meshes")
    parser.add_argument("--surfaces", default=",".join(gallery.SHAPES))
    parser.add_argument("--points", default="5000,50000")
    parser.add_argument("--noise", default="0,0.001,0.002,0.005", help="fractions of the diagonal")
    parser.add_argument("--resolution", type=int, default=256)
    arguments = parser.parse_args()
    config = ReconstructionConfig(resolution=arguments.resolution)
    rows = []
    for name in arguments.surfaces.split(","):
        truth = load_surface(name, arguments.meshes)
        places = _around(truth)
        inside = is_inside(places, truth)
        sizes = [int(points) for points in arguments.points.split(",")]
        noises = [float(noise) for noise in arguments.noise.split(",")]
        for points, noise in itertools.product(sizes, noises):
            cloud = uniform_scan(truth, points, noise=noise, normal_noise=NORMAL_NOISE)
            assert cloud.normals is not None
            found = estimate_normals(cloud.points)
            wrong = np.einsum("pi,pi->p", found, cloud.normals) < 0
            overlaps = [
                occupancy_iou(reconstruct(scan, config).mesh, places, inside)
                for scan in (PointCloud(cloud.points), cloud)
            ]
            shown = [f"{overlap:.3f}" for overlap in overlaps]
            row = [name, str(points), f"{100 * noise:g} %", f"{100 * wrong.mean():.2f} %", *shown]
            rows.append(row)
            print(*row, flush=True)
    header = ["surface", "points", "noise", "wrong side", "overlap", "with own normals"]
    print(f"\n{markdown_table(header, rows)}")


def _around(truth: Mesh) -> np.ndarray:
    """Places (PLACES, 3) near the surface, evenly on both sides."""
    points, normals = sample_surface(truth, PLACES, 0)
    diagonal = np.linalg.norm(np.ptp(truth.vertices, axis=0))
    away = np.random.default_rng(0).uniform(-WITHIN, WITHIN, len(points)) * diagonal
    return points + away[:, None] * normals


if __name__ == "__main__":
    main()
