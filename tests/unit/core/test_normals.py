"""Estimated normals have the surface's direction and point out of every body."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import KDTree

from visco_core.gallery import sphere, torus, two_bodies, uniform_scan
from visco_core.gallery.scanner import rotation
from visco_core.normals import _spanning_tree, estimate_normals
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


def test_signs_are_carried_along_the_neighbour_graphs_minimum_spanning_tree() -> None:
    points = uniform_scan(torus(), 2000).points
    nearest = KDTree(points).query(points, 9)[1]
    directions = np.random.default_rng(0).standard_normal(points.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    tree, group = _spanning_tree(directions, nearest, never)
    cost = 1.0001 - np.abs(np.einsum("pi,pki->pk", directions, directions[nearest[:, 1:]]))
    source = np.repeat(np.arange(2000), 8)
    graph = csr_matrix((cost.ravel(), (source, nearest[:, 1:].ravel())), shape=(2000, 2000))
    expected = minimum_spanning_tree(graph)
    assert tree.nnz == 2 * expected.nnz
    assert tree.sum() == pytest.approx(2 * expected.sum())
    assert len(np.unique(group)) == 2000 - expected.nnz


def test_more_points_than_a_block_keep_their_order() -> None:
    cloud = uniform_scan(sphere(), 70_000)
    found = estimate_normals(cloud.points)
    assert degrees_off(found, cloud.normals).max() < 45
