"""Confidence is one where the scan holds the surface, and falls to zero where it was made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from visco_core.confidence import CELL, ENOUGH, cluster_points, confidence
from visco_core.config import ReconstructionConfig
from visco_core.errors import Stopped
from visco_core.gallery import (
    Scanner,
    Shape,
    bracket,
    bumpy_torus,
    octopus,
    scan,
    sphere,
    thin_plate,
    torus,
    uniform_scan,
    vary_density,
)
from visco_core.kernels import Backend, choose_backend
from visco_core.pointcloud import PointCloud
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh

RESOLUTION = 128


def judged(mesh: Mesh, cloud: PointCloud, **options: Any) -> np.ndarray:
    """The confidence of ``mesh``, both within [-1, 1]³, on a grid of 128 voxels."""
    assert cloud.normals is not None
    placed = replace(mesh, vertices=0.45 * mesh.vertices + 0.5)
    given = {"backend": choose_backend("native", "cpu", 2), **options}
    return confidence(placed, 0.45 * cloud.points + 0.5, cloud.normals, RESOLUTION, **given)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return sphere().mesh(48)


@pytest.mark.parametrize("count", [1000, 10_000, 200_000])
def test_an_evenly_scanned_surface_is_held_everywhere_however_wide_its_points_lie(
    count: int, ball: Mesh
) -> None:
    found = judged(ball, uniform_scan(sphere(), count))
    assert found.dtype == np.float32
    assert found.shape == (len(ball.vertices),)
    assert 0 <= found.min() <= found.max() <= 1
    assert np.median(found) > 0.8
    assert np.quantile(found, 0.05) > 0.5


def test_it_is_half_at_the_rim_of_a_hole_and_falls_on_the_way_into_it(ball: Mesh) -> None:
    cloud = uniform_scan(sphere(), 20_000)
    found = judged(ball, cloud.select(cloud.points[:, 2] > 0))
    height = ball.vertices[:, 2]
    ways = np.arange(0.05, -1, -0.1)
    means = [found[np.abs(height - way) < 0.05].mean() for way in ways]
    assert np.all(np.diff(means) <= 0)
    assert 0.3 < found[np.abs(height) < 0.03].mean() < 0.7
    assert found[height > 0.15].mean() > 0.9
    assert found[height < -0.4].max() < 0.02


def test_a_density_that_varies_a_hundredfold_is_no_hole() -> None:
    shape = torus()
    found = judged(shape.mesh(64), vary_density(uniform_scan(shape, 150_000), 100))
    assert np.quantile(found, 0.03) > 0.4
    assert np.median(found) > 0.85


def cap_of(cloud: PointCloud, height: float) -> np.ndarray:
    return cloud.points[:, 2] > height


def test_one_stray_point_in_a_hole_does_not_support_it_and_a_patch_does(ball: Mesh) -> None:
    cloud = uniform_scan(sphere(), 20_000)
    hole = cloud.select(~cap_of(cloud, 0.8))
    pole = np.linalg.norm(ball.vertices - [0, 0, 1], axis=1) < 0.03
    up = np.array([[0.0, 0, 1]])
    summit = PointCloud(up, up.astype(np.float32))

    def with_points(more: PointCloud) -> np.ndarray:
        joined = [
            np.concatenate([getattr(c, k) for c in (hole, more)]) for k in ("points", "normals")
        ]
        return judged(ball, PointCloud(*joined))[pole]

    assert with_points(summit).max() < 0.2
    assert with_points(cloud.select(cap_of(cloud, 0.98))).min() > 0.6


def test_points_whose_normals_have_nothing_in_common_support_no_surface(ball: Mesh) -> None:
    cloud = uniform_scan(sphere(), 20_000)
    random = np.random.default_rng(0).standard_normal(cloud.points.shape)
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    found = judged(ball, replace(cloud, normals=random.astype(np.float32)))
    assert np.median(found) < 0.1
    assert judged(ball, replace(cloud, normals=-cloud.normals)).max() == 0


def test_each_side_of_a_thin_wall_is_held_by_its_own_points_alone() -> None:
    plate = thin_plate(0.04)
    mesh, cloud = plate.mesh(128), uniform_scan(plate, 40_000)
    assert mesh.normals is not None
    inner = np.abs(mesh.vertices[:, :2]).max(1) < 0.5
    above, below = inner & (mesh.normals[:, 2] > 0.9), inner & (mesh.normals[:, 2] < -0.9)
    both = judged(mesh, cloud)
    assert both[above].mean() > 0.85
    assert both[below].mean() > 0.85
    upper = judged(mesh, cloud.select(cloud.points[:, 2] > 0.01))
    assert upper[above].mean() > 0.85
    assert upper[below].max() < 0.02


SCANS: dict[str, tuple[Callable[[], Shape], Scanner]] = {
    "octopus with holes": (octopus, Scanner(views=8, holes=6, hole_radius=0.08, noise=1e-3)),
    "bracket with holes": (bracket, Scanner(views=6, holes=5, hole_radius=0.07)),
    "noisy torus with holes": (
        torus,
        Scanner(noise=0.01, normal_noise=35, holes=3, hole_radius=0.1),
    ),
}


def solved(shape: Shape, scanner: Scanner, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the true surface and confidence of each vertex of the scan's mesh."""
    config = ReconstructionConfig(resolution=96, device="cpu", threads=2)
    mesh = reconstruct(scan(shape, scanner, seed=seed), config).mesh
    return np.abs(shape.sdf(mesh.vertices)), mesh.attributes["confidence"]


@pytest.mark.parametrize(
    ("name", "times"),
    [("octopus with holes", 5), ("bracket with holes", 5), ("noisy torus with holes", 2)],
)
def test_the_error_falls_as_the_confidence_grows(name: str, times: float) -> None:
    """From the last tenth to the first by so many times: less where the scan itself is noisy.

    Four scans, since the smoothed noise of one is alike over too much of it for a tenth's mean.
    """
    make, scanner = SCANS[name]
    scans = [solved(make(), scanner, seed) for seed in range(1, 5)]
    error, found = (np.concatenate(each) for each in zip(*scans, strict=True))
    tenths = np.array_split(np.argsort(found, kind="stable"), 10)
    means = [error[tenth].mean() for tenth in tenths]
    # Among the tenths that the scan holds only its noise is left, and they are nearly alike.
    assert np.all(np.diff(means) < 0.04 * means[-1]), means
    fifths = np.reshape(means, (5, 2)).mean(1)
    assert np.all(np.diff(fifths) < 0), means
    assert means[0] > times * means[-1]


def test_what_is_built_through_stray_points_has_no_confidence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Otherwise they are dropped before, where there are enough to be told.
    monkeypatch.setattr(
        "visco_core.clean.find_scattered", lambda points, *_: np.zeros(len(points), bool)
    )
    shape = octopus()
    error, found = solved(shape, Scanner(views=8, outliers=0.02, noise=1e-3))
    made_up = error > 0.05 * shape.diagonal
    assert made_up.mean() > 0.2
    assert np.quantile(found[made_up], 0.9) < 0.2
    assert np.median(found[error < 0.005 * shape.diagonal]) > 0.7


def test_a_cluster_holds_the_points_of_its_cell_that_face_one_way() -> None:
    cloud = uniform_scan(bumpy_torus(), 3000)
    assert cloud.normals is not None
    points = 0.45 * cloud.points + 0.5
    clusters = cluster_points(points, cloud.normals, 13)
    start = 0
    for size in clusters.sizes:
        rows = clusters.rows[start : start + size]
        assert rows[:, 0].sum() == len(points)
        np.testing.assert_allclose((rows[:, :1] * rows[:, 1:4]).sum(0), points.sum(0), rtol=1e-5)
        np.testing.assert_allclose(rows[:, 4:7].sum(0), cloud.normals.sum(0), atol=1e-2)
        start += size
    # Those of a cell whose normals are nearest to one axis differ by two right angles at most.
    assert np.linalg.norm(clusters.rows[: clusters.sizes[0], 4:7], axis=1).min() > 0.5


def test_the_radius_is_where_the_points_nearness_adds_up_to_enough(backend: Backend) -> None:
    """Against a sum over all points, on a level whose cells hold one point each."""
    points = np.stack(np.meshgrid(np.arange(16), np.arange(16)), -1).reshape(-1, 2) / 16 + 1 / 32
    points = np.column_stack([points, np.full(len(points), 0.53)])
    up = np.tile(np.float32([0, 0, 1]), (len(points), 1))
    clusters = cluster_points(points, up, 16)
    assert clusters.sizes[0] == len(points)
    places = np.float32([[0.5, 0.5, 0.53], [0.41, 0.61, 0.5]])
    tables = [backend.array(table) for table in clusters.tables]
    given = [backend.array(array) for array in (places, up[:2])]
    for enough in (0.7, 1.5):
        found = backend.numpy(backend.kernels.support(*given, *tables, enough))
        for place, (square, _, cosine) in zip(places, found, strict=True):
            nearness = 1 - np.square(points - place).sum(1) * 16**2
            weight = np.maximum(nearness, 0).sum()
            if weight >= enough:
                assert square == pytest.approx(16.0**-2)
            else:
                assert square > 16.0**-2
            assert cosine == pytest.approx(1)


def test_nothing_is_told_apart_below_the_least_radius(ball: Mesh) -> None:
    """A slit half as wide as a cell, in a dense scan."""
    cloud = uniform_scan(sphere(), 100_000)
    width = CELL / RESOLUTION / 0.45 / 2
    slit = cloud.select(np.abs(cloud.points[:, 2]) > width / 2)
    assert len(slit) < len(cloud) - ENOUGH
    assert judged(ball, slit)[np.abs(ball.vertices[:, 2]) < width].min() > 0.9


def test_a_stop_is_heeded_while_it_is_found(ball: Mesh) -> None:
    cloud, asked = uniform_scan(sphere(), 2000), []

    def stop() -> None:
        asked.append(1)
        if len(asked) > 12:
            raise Stopped

    with pytest.raises(Stopped):
        judged(ball, cloud, check=stop)
