"""Normals on the wrong side are found where that can be known, and right ones stay."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core.errors import Stopped
from visco_core.gallery import SHAPES, sphere, thin_plate, two_bodies, uniform_scan, vary_density
from visco_core.pointcloud import PointCloud
from visco_core.sides import wrong_sides


def found(cloud: PointCloud, turned: np.ndarray) -> np.ndarray:
    """What is found where the mask ``turned`` (P,) says which normals are turned."""
    assert cloud.normals is not None
    return wrong_sides(cloud.points, np.where(turned[:, None], -cloud.normals, cloud.normals))


def nothing(cloud: PointCloud) -> np.ndarray:
    return np.zeros(len(cloud), bool)


def random_share(cloud: PointCloud, share: float) -> np.ndarray:
    return np.random.default_rng(8).random(len(cloud)) < share


def sheet() -> PointCloud:
    """A wavy one, which has no inside."""
    points = np.random.default_rng(2).random((20_000, 3))
    points[:, 2] = 0.05 * np.sin(9 * points[:, 0])
    slope = 0.45 * np.cos(9 * points[:, 0])
    normals = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return PointCloud(points, normals.astype(np.float32))


def bowl() -> PointCloud:
    ball = uniform_scan(sphere(), 20_000)
    return ball.select(ball.points[:, 2] < 0)


@pytest.mark.parametrize("shape", [*SHAPES])
@pytest.mark.parametrize(("count", "noise"), [(20_000, 0.001), (5000, 0.002), (20_000, 0.01)])
def test_no_normal_of_a_good_scan_is_turned(shape: str, count: int, noise: float) -> None:
    cloud = uniform_scan(SHAPES[shape](), count, noise=noise, normal_noise=8 + 2700 * noise)
    assert not found(cloud, nothing(cloud)).any()


def test_no_normal_is_turned_where_the_density_varies_a_thousandfold() -> None:
    cloud = vary_density(uniform_scan(SHAPES["octopus"](), 50_000, noise=0.001), 1000)
    assert not found(cloud, nothing(cloud)).any()


@pytest.mark.parametrize("cloud", [sheet(), bowl()], ids=["sheet", "bowl"])
def test_normals_of_an_open_surface_that_agree_may_face_either_way(cloud: PointCloud) -> None:
    assert not found(cloud, nothing(cloud)).any()
    assert not found(cloud, ~nothing(cloud)).any()


@pytest.mark.parametrize(("count", "noise"), [(10_000, 0.001), (100_000, 0.003)])
def test_the_walls_of_a_plate_that_points_mix_keep_their_sides(count: int, noise: float) -> None:
    cloud = uniform_scan(thin_plate(0.0155), count, noise=noise, normal_noise=8)
    assert not found(cloud, nothing(cloud)).any()


@pytest.mark.parametrize("shape", ["octopus", "bracket"])
@pytest.mark.parametrize("share", [0.03, 0.1, 0.3, 0.4, 0.5])
def test_normals_turned_at_random_are_found(shape: str, share: float) -> None:
    cloud = uniform_scan(SHAPES[shape](), 20_000, noise=0.001, normal_noise=8)
    turned = random_share(cloud, share)
    assert (found(cloud, turned) != turned).mean() < 0.005


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_on_an_open_sheet_the_side_of_most_normals_is_taken(share: float) -> None:
    cloud = sheet()
    turned = random_share(cloud, share)
    assert (found(cloud, turned) != turned).mean() < 0.005
    assert (found(cloud, ~turned) != turned).mean() < 0.005


@pytest.mark.parametrize("shape", ["octopus", "bracket", "thin_plate"])
def test_normals_that_all_point_inward_are_found(shape: str) -> None:
    cloud = uniform_scan(SHAPES[shape](), 20_000, noise=0.001, normal_noise=8)
    assert found(cloud, ~nothing(cloud)).all()


def test_one_of_two_bodies_that_is_inside_out_is_found() -> None:
    cloud = uniform_scan(two_bodies(), 20_000, noise=0.001, normal_noise=8)
    turned = cloud.points[:, 0] > 0
    assert (found(cloud, turned) != turned).mean() < 0.001


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_part_that_is_inside_out_is_found(share: float) -> None:
    cloud = uniform_scan(SHAPES["octopus"](), 20_000, noise=0.001, normal_noise=8)
    turned = cloud.points[:, 2] < np.quantile(cloud.points[:, 2], share)
    assert (found(cloud, turned) != turned).mean() < 0.001


@pytest.mark.parametrize("call", [1, 3, 10])
def test_a_stop_request_ends_the_search(call: int) -> None:
    cloud = uniform_scan(sphere(), 5000)
    asked: list[None] = []

    def check() -> None:
        asked.append(None)
        if len(asked) == call:
            raise Stopped

    normals = np.where(random_share(cloud, 0.5)[:, None], -1, 1) * cloud.normals
    with pytest.raises(Stopped):
        wrong_sides(cloud.points, normals, check=check)
