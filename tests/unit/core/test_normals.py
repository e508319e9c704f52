"""Estimated normals have the surface's direction and point out of every body."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core.gallery import sphere, torus, two_bodies, uniform_scan
from visco_core.gallery.scanner import rotation
from visco_core.normals import estimate_normals


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


def test_more_points_than_a_block_keep_their_order() -> None:
    cloud = uniform_scan(sphere(), 70_000)
    found = estimate_normals(cloud.points)
    assert degrees_off(found, cloud.normals).max() < 45
