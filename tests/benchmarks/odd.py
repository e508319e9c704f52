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
from visco_core.gallery.damage import random_directions
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
Damage = Callable[[PointCloud], PointCloud]


def _bare(cloud: PointCloud) -> PointCloud:
    """Without normals."""
    return PointCloud(cloud.points)


def _rounded(cloud: PointCloud) -> PointCloud:
    """Coordinates as a file with few digits has them: 500 steps along the longest side."""
    step = np.ptp(cloud.points, axis=0).max() / 500
    return PointCloud(step * np.rint(cloud.points / step), cloud.normals)


def _repeated(cloud: PointCloud) -> PointCloud:
    """Twice as many points, drawn with replacement."""
    return cloud.select(np.random.default_rng(0).integers(0, len(cloud), 2 * len(cloud)))


def _with_blobs(cloud: PointCloud) -> PointCloud:
    """20 blobs of 30 points a tenth of the longest side off the surface, a hundredth wide."""
    rng = np.random.default_rng(0)
    size = np.ptp(cloud.points, axis=0).max()
    assert cloud.normals is not None
    chosen = rng.integers(0, len(cloud), 20)
    middles = cloud.points[chosen] + 0.1 * size * cloud.normals[chosen]
    blobs = np.repeat(middles, 30, axis=0) + 0.01 * size * rng.standard_normal((600, 3))
    normals = random_directions(600, rng).astype(np.float32)
    return PointCloud(
        np.concatenate([cloud.points, blobs]), np.concatenate([cloud.normals, normals])
    )


_DAMAGES: dict[str, Damage] = {
    "good": lambda cloud: cloud,
    "flipped-10": lambda cloud: gallery.flip_normals(cloud, 0.1),
    "flipped-30": lambda cloud: gallery.flip_normals(cloud, 0.3),
    "flipped-50": lambda cloud: gallery.flip_normals(cloud, 0.5),
    "inward": lambda cloud: gallery.flip_normals(cloud, 1.0),
    "outliers-5": lambda cloud: gallery.add_outliers(cloud, 0.05),
    "outliers-20": lambda cloud: gallery.add_outliers(cloud, 0.2),
    "blobs": _with_blobs,
    "rounded": _rounded,
    "duplicates": _repeated,
    "density-100x": lambda cloud: gallery.vary_density(cloud, 100.0),
    "density-1000x": lambda cloud: gallery.vary_density(cloud, 1000.0),
}
_ABOUT_NORMALS = ("flipped", "inward")


def _damaged(meshes: Path | None) -> dict[str, Recipe]:
    """One good scan, made worse in one way at a time, with and without normals."""
    surface = "fertility" if meshes is not None else "octopus"

    def recipe(*damages: Damage) -> Recipe:
        def make() -> tuple[PointCloud, Mesh]:
            truth = load_surface(surface, meshes)
            cloud = uniform_scan(truth, _COUNT, noise=_NOISE, normal_noise=8.0)
            for damage in damages:
                cloud = damage(cloud)
            return cloud, truth

        return make

    recipes: dict[str, Recipe] = {}
    for name, damage in _DAMAGES.items():
        recipes[name] = recipe(damage)
        if not name.startswith(_ABOUT_NORMALS):
            recipes[f"{name}-no-normals"] = recipe(damage, _bare)
    return recipes


def _shapes(resolution: int) -> dict[str, Recipe]:
    """Thin, sharp, several, open, touching almost."""

    def recipe(make: Callable[[], Mesh], *damages: Damage) -> Recipe:
        def made() -> tuple[PointCloud, Mesh]:
            surface = make()
            cloud = uniform_scan(surface, _COUNT, noise=0.0003, normal_noise=5.0)
            for damage in damages:
                cloud = damage(cloud)
            return cloud, surface

        return made

    def thin_plate() -> Mesh:
        # The plate is the longest shape's 1.8 across, and the grid leaves a margin around it.
        return gallery.thin_plate(2.0 * 1.8 * 1.1 / resolution).mesh(400)

    def bracket() -> Mesh:
        return gallery.bracket().mesh(300)

    def half_open() -> Mesh:
        whole = gallery.bumpy_torus().mesh(300)
        upper = (whole.vertices[whole.faces][:, :, 2] > -0.05).all(axis=1)
        return Mesh(whole.vertices, whole.faces[upper], whole.normals)

    def stacked_boxes() -> Mesh:
        """Two cubes, 2 % of their side apart."""
        one = gallery.box((0.5, 0.5, 0.5)).mesh(300)
        above = one.vertices + np.array([0, 0, 1.02])
        faces = np.concatenate([one.faces, one.faces + len(one.vertices)])
        return Mesh(np.concatenate([one.vertices, above]), faces, None)

    outliers = _DAMAGES["outliers-5"]
    return {
        "thin-plate": recipe(thin_plate),
        "thin-plate-outliers-5": recipe(thin_plate, outliers),
        "thin-plate-outliers-5-no-normals": recipe(thin_plate, outliers, _bare),
        "sharp-box": recipe(lambda: gallery.box().mesh(300)),
        "sharp-bracket": recipe(bracket),
        "bracket-no-normals": recipe(bracket, _bare),
        "bracket-outliers-5-no-normals": recipe(bracket, outliers, _bare),
        "two-bodies": recipe(lambda: gallery.two_bodies().mesh(300)),
        "stacked-boxes": recipe(stacked_boxes),
        "stacked-boxes-no-normals": recipe(stacked_boxes, _bare),
        "open-half": recipe(half_open),
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
