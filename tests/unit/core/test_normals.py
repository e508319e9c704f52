"""Estimated normals have the surface's direction and point out of every body."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core.errors import Stopped
from visco_core.facing import side_agreement
from visco_core.gallery import (
    SHAPES,
    Scanner,
    scan,
    sphere,
    thin_plate,
    torus,
    two_bodies,
    uniform_scan,
)
from visco_core.gallery.scanner import rotation
from visco_core.normals import estimate_normals
from visco_core.orientation import SITES, _grouped
from visco_core.pointcloud import PointCloud
from visco_core.progress import never


def degrees_off(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Angle (P,) between signed directions."""
    return np.degrees(np.arccos(np.clip(np.einsum("pi,pi->p", found, exact), -1, 1)))


@pytest.mark.parametrize("make", [sphere, torus])
def test_normals_of_a_smooth_body_are_right_and_point_outward(make) -> None:
    cloud = uniform_scan(make(), 6000)
    found = estimate_normals(cloud.points)
    assert found.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)
    off = degrees_off(found, cloud.normals)
    assert np.median(off) < 3
    assert off.max() < 45


def test_bodies_apart_are_each_turned_outward() -> None:
    cloud = uniform_scan(two_bodies(), 6000)
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.002


def test_noise_turns_no_side_around() -> None:
    cloud = uniform_scan(sphere(), 6000, noise=0.003)
    assert degrees_off(estimate_normals(cloud.points), cloud.normals).max() < 90


@pytest.mark.parametrize("shift", [0.0, 1e7])
def test_place_unit_and_attitude_of_the_scan_change_nothing(shift: float) -> None:
    cloud = uniform_scan(torus(), 3000)
    turn = rotation(np.array([0.6, 0.0, 0.8]), 1.0)
    plain = estimate_normals(cloud.points)
    moved = estimate_normals(shift + 1e3 * cloud.points @ turn.T)
    assert degrees_off(moved, plain @ turn.T).max() < 0.1


def test_a_plane_has_one_side() -> None:
    points = np.random.default_rng(0).random((500, 3)) * [1, 1, 0]
    found = estimate_normals(points)
    np.testing.assert_allclose(np.abs(found), [[0, 0, 1]] * 500, atol=1e-6)
    assert len(np.unique(found[:, 2] > 0)) == 1


def test_four_points_of_a_tetrahedron_suffice() -> None:
    found = estimate_normals(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=1e-6)


def hollow_ball(radius: float, outside: int = 6000, inside: int = 4000) -> PointCloud:
    """A unit ball with a ball of this radius taken out of its middle."""
    outer, inner = uniform_scan(sphere(1.0), outside), uniform_scan(sphere(radius), inside)
    return PointCloud(
        np.concatenate([outer.points, inner.points]),
        np.concatenate([outer.normals, -inner.normals]),
    )


def test_a_cavitys_wall_points_into_the_cavity() -> None:
    cloud = hollow_ball(0.6)
    assert degrees_off(estimate_normals(cloud.points), cloud.normals).max() < 90


def test_a_body_inside_a_cavity_points_outward_again() -> None:
    shell, core = hollow_ball(0.7), uniform_scan(sphere(0.3), 2000)
    points = np.concatenate([shell.points, core.points])
    exact = np.concatenate([shell.normals, core.normals])
    assert degrees_off(estimate_normals(points), exact).max() < 90


def test_the_two_faces_of_a_plate_point_away_from_each_other() -> None:
    # A fiftieth as thick as it is wide: four spacings of the points.
    cloud = uniform_scan(thin_plate(0.04), 20_000)
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.02


def test_a_shell_thinner_than_its_points_are_apart_has_an_inside() -> None:
    # 0.05 thick, the points of either face 0.07 apart.
    cloud = hollow_ball(0.95, 2600, 2400)
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.01


def test_directions_come_from_so_few_neighbours_that_close_walls_stay_apart() -> None:
    """16 neighbours fill the space between two plates; 8 lie on one face."""
    plate, apart = uniform_scan(thin_plate(0.06), 3000), np.array([0.0, 0.0, 0.08])
    points = np.concatenate([plate.points - apart, plate.points + apart])
    exact = np.concatenate([plate.normals, plate.normals])
    assert np.median(degrees_off(estimate_normals(points), exact)) < 5


def test_walls_as_close_as_the_points_get_directions_from_a_wider_view() -> None:
    """Every neighbourhood of 16 holds both faces of the shell; one point in nine shows a sheet."""
    cloud = hollow_ball(0.9, 2700, 2300)
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.002


def test_neighbours_across_a_wall_say_little_and_those_around_an_edge_all() -> None:
    points = np.array([[0.0, 0, 0], [0.1, 0, -0.05], [0.1, 0, -0.1]])
    directions = np.array([[0.0, 0, 1], [0, 0, 1], [1, 0, 0]])
    grouping, solving = side_agreement(points, directions, np.array([0, 0]), np.array([1, 2]))
    assert 0 < grouping[0] < 0.05
    assert abs(solving[0]) < 0.05
    assert solving[1] == pytest.approx(1)


def test_patches_of_a_plate_that_noise_has_grouped_wrongly_turn_each_for_itself() -> None:
    # The faces lie one spacing and five deviations of the noise apart.
    cloud = uniform_scan(thin_plate(), 5000, noise=0.002)
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.05


def test_points_that_have_joined_the_other_walls_patch_are_outvoted() -> None:
    outer = uniform_scan(sphere(1.0), 2600, noise=0.002, seed=2)
    inner = uniform_scan(sphere(0.95), 2400, noise=0.002, seed=3)
    found = estimate_normals(np.concatenate([outer.points, inner.points]))
    exact = np.concatenate([outer.normals, -inner.normals])
    assert (degrees_off(found, exact) > 90).mean() < 0.009


def test_noise_coarser_than_the_points_distance_is_seen_through() -> None:
    cloud = uniform_scan(sphere(), 50_000, noise=0.005)
    off = degrees_off(estimate_normals(cloud.points), cloud.normals)
    assert np.median(off) < 12
    assert (off > 90).mean() < 0.005


def test_an_open_sheet_has_one_side() -> None:
    place = np.random.default_rng(0).random((5000, 2))
    wave = 0.1 * np.sin(7 * place)
    found = estimate_normals(np.column_stack([place, wave.sum(1)]))
    slope = np.column_stack([-0.7 * np.cos(7 * place), np.ones(len(place))])
    assert len(np.unique(np.einsum("pi,pi->p", found, slope) > 0)) == 1


def test_more_points_than_are_grouped_take_their_sites_side() -> None:
    cloud = uniform_scan(torus(), 2 * SITES)
    assert degrees_off(estimate_normals(cloud.points), cloud.normals).max() < 90


def test_grouping_follows_the_strongest_links_and_their_signs() -> None:
    first, second = np.array([0, 1, 2, 3]), np.array([1, 2, 3, 4])
    link = np.array([1.0, -2.0, 0.1, -3.0])
    group, signs = _grouped(first, second, link, 6, 3, never)
    assert group[0] == group[1] == group[2] != group[3] == group[4]
    assert len(np.unique(group)) == 3
    assert signs[0] == signs[1] == -signs[2]
    assert signs[3] == -signs[4]


def test_a_stop_is_heeded_before_the_sides_are_known() -> None:
    asked = []

    def stop_later() -> None:
        asked.append(True)
        if len(asked) == 20:
            raise Stopped

    with pytest.raises(Stopped):
        estimate_normals(uniform_scan(sphere(), 5000).points, check=stop_later)


def test_more_points_than_a_block_keep_their_order() -> None:
    cloud = uniform_scan(sphere(), 70_000)
    found = estimate_normals(cloud.points)
    assert degrees_off(found, cloud.normals).max() < 45


@pytest.mark.parametrize("shape", ["bracket", "bumpy_torus"])
def test_a_surface_seen_from_one_side_is_not_bent_to_close_itself(shape: str) -> None:
    """Some of its patches turned, the winding numbers would be nearer to ½."""
    view = np.array([[1.0, 0.5, 0.3]])
    cloud = scan(SHAPES[shape](), Scanner(views=view, points=2500, normals="exact"))
    assert cloud.normals is not None
    assert (degrees_off(estimate_normals(cloud.points), cloud.normals) > 90).mean() < 0.005
