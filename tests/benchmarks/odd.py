"""Hard scans: ``python -m tests.benchmarks.odd --meshes DIR --scans DIR``.

Distances are from point to triangle, in thousandths of the diagonal. Of a real scan the truth is
the whole scan, of which the methods see a part.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
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
from tests.benchmarks.peers import add_method_arguments, methods_of
from tests.benchmarks.surfaces import load_surface
from tests.benchmarks.tables import markdown_table, rounded
from visco_core import gallery
from visco_core.gallery import uniform_scan, write_scan
from visco_core.io import read_points
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh

_COUNT = 100_000
_NOISE = 0.001
_REAL_SHARES = (0.01, 0.1, 0.25)
HEADER = (
    *("case", "method", "gt to mesh, mean", "max", "mesh to gt, mean", "max"),
    *("seconds", "components", "whole"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--meshes", type=Path, help="folder of watertight meshes")
    parser.add_argument("--scans", type=Path, help="folder of real scans with normals")
    parser.add_argument("--cases", default="", help="comma-separated beginnings of names")
    add_method_arguments(parser)
    add_contest_arguments(parser)
    arguments = parser.parse_args()
    methods = methods_of(arguments)
    scores = list(compete(_cases(arguments), methods, arguments))
    print(markdown_table(HEADER, [_row(score) for score in scores if score.metrics is not None]))
    print_problems(scores)
    if arguments.json:
        write_report(arguments.json, arguments, scores)


def _row(score: Score) -> list[str]:
    sides, health = (score.metrics or {})["point_to_triangle"], score.health or {}
    cells = []
    for side in ("gt_to_mesh", "mesh_to_gt"):
        for kind in ("mean", "max"):
            value = sides[side] and 1000.0 * sides[side][kind] / score.tags["diagonal"]
            cells.append(rounded(value, 2))
    whole = health["watertight"] and health["outward"]
    cost = [rounded(score.seconds, 2), str(health["components"]), "yes" if whole else "no"]
    return [score.case, score.method, *cells, *cost]


def _cases(arguments: argparse.Namespace) -> Iterator[Case]:
    folder = arguments.work.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    beginnings = tuple(arguments.cases.split(","))
    recipes = {**_damaged(arguments.meshes), **_shapes(arguments.resolution)}
    if arguments.scans is not None:
        recipes |= _parts_of_scans(arguments.scans)
    for name, make in recipes.items():
        if not name.startswith(beginnings):
            continue
        cloud, truth = make()
        points = truth.vertices if isinstance(truth, Mesh) else truth.points
        diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
        scan = write_scan(cloud, folder / f"{name}.scan.ply")
        yield Case(name, scan, truth, tags={"diagonal": diagonal})


Recipe = Callable[[], tuple[PointCloud, Mesh | PointCloud]]


def _damaged(meshes: Path | None) -> dict[str, Recipe]:
    """One good scan, made worse in one way at a time."""
    surface = "fertility" if meshes is not None else "octopus"

    def recipe(damage: Callable[[PointCloud], PointCloud]) -> Recipe:
        def make() -> tuple[PointCloud, Mesh]:
            truth = load_surface(surface, meshes)
            cloud = uniform_scan(truth, _COUNT, noise=_NOISE, normal_noise=8.0)
            return damage(cloud), truth

        return make

    return {
        "good": recipe(lambda cloud: cloud),
        "flipped-10": recipe(lambda cloud: gallery.flip_normals(cloud, 0.1)),
        "flipped-30": recipe(lambda cloud: gallery.flip_normals(cloud, 0.3)),
        "flipped-50": recipe(lambda cloud: gallery.flip_normals(cloud, 0.5)),
        "inward": recipe(lambda cloud: gallery.flip_normals(cloud, 1.0)),
        "outliers-5": recipe(lambda cloud: gallery.add_outliers(cloud, 0.05)),
        "outliers-20": recipe(lambda cloud: gallery.add_outliers(cloud, 0.2)),
        "outliers-5-no-normals": recipe(
            lambda cloud: PointCloud(gallery.add_outliers(cloud, 0.05).points)
        ),
        "density-100x": recipe(lambda cloud: gallery.vary_density(cloud, 100.0)),
        "no-normals": recipe(lambda cloud: PointCloud(cloud.points)),
    }


def _shapes(resolution: int) -> dict[str, Recipe]:
    """Thin, sharp, several, open."""

    def recipe(surface: Mesh, *, normals: bool = True) -> tuple[PointCloud, Mesh]:
        cloud = uniform_scan(surface, _COUNT, noise=0.0003, normal_noise=5.0)
        return (cloud if normals else PointCloud(cloud.points)), surface

    # The plate is the longest shape's 1.8 across, and the grid leaves a margin around it.
    two_voxels = 2.0 * 1.8 * 1.1 / resolution

    def half_open() -> Mesh:
        whole = gallery.bumpy_torus().mesh(300)
        upper = (whole.vertices[whole.faces][:, :, 2] > -0.05).all(axis=1)
        return Mesh(whole.vertices, whole.faces[upper], whole.normals)

    def bracket_with_outliers() -> tuple[PointCloud, Mesh]:
        cloud, surface = recipe(gallery.bracket().mesh(300), normals=False)
        return gallery.add_outliers(cloud, 0.05), surface

    return {
        "thin-plate": lambda: recipe(gallery.thin_plate(two_voxels).mesh(400)),
        "sharp-box": lambda: recipe(gallery.box().mesh(300)),
        "sharp-bracket": lambda: recipe(gallery.bracket().mesh(300)),
        "bracket-no-normals": lambda: recipe(gallery.bracket().mesh(300), normals=False),
        "bracket-outliers-5-no-normals": bracket_with_outliers,
        "two-bodies": lambda: recipe(gallery.two_bodies().mesh(300)),
        "open-half": lambda: recipe(half_open()),
    }


def _parts_of_scans(folder: Path) -> dict[str, Recipe]:
    recipes: dict[str, Recipe] = {}
    for path in sorted(folder.glob("*.ply")):
        for share in _REAL_SHARES:
            recipes[f"{path.stem}-{100.0 * share:g}%"] = lambda path=path, share=share: _part(
                path, share
            )
    return recipes


def _part(path: Path, share: float) -> tuple[PointCloud, PointCloud]:
    whole = read_points(path)
    return gallery.subsample(whole, round(share * len(whole))), whole


if __name__ == "__main__":
    main()
