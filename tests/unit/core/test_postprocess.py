"""Trimming, decimation and colours leave a mesh that is what its settings ask for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from visco_core.config import ReconstructionConfig
from visco_core.errors import InputError
from visco_core.gallery import sphere, uniform_scan
from visco_core.io.faces import vertex_normals
from visco_core.mesh_health import mesh_health
from visco_core.metrics import nearest_distance
from visco_core.pointcloud import PointCloud
from visco_core.postprocess import (
    carry_attributes,
    decimate,
    finish_mesh,
    with_confidence,
)
from visco_core.result import Mesh
from visco_core.trim import LEAST_CUT, trim


@pytest.fixture(scope="module")
def ball() -> Mesh:
    return sphere().mesh(24)


@pytest.fixture(scope="module")
def half_scan() -> PointCloud:
    """The upper half of the sphere, coloured by height and with a scalar."""
    cloud = uniform_scan(sphere(), 8000)
    cloud = cloud.select(cloud.points[:, 2] > 0)
    height = cloud.points[:, 2]
    colors = np.stack([255 * height, np.zeros_like(height), 255 - 255 * height], 1)
    return dataclasses.replace(
        cloud, colors=colors.astype(np.uint8), scalars={"height": height.astype(np.float32)}
    )


def test_trim_opens_the_mesh_and_keeps_only_what_is_near_a_point(
    ball: Mesh, half_scan: PointCloud
) -> None:
    trimmed = trim(ball, half_scan.points, 0.1)
    health = mesh_health(trimmed)
    assert not health["watertight"]
    assert health["boundary_edges"] > 20
    assert (health["components"], health["nonmanifold_edges"]) == (1, 0)
    assert health["unused_vertices"] == 0
    edge = np.linalg.norm(np.ptp(ball.vertices[ball.faces], axis=1), axis=1).max()
    away = nearest_distance(trimmed.vertices, half_scan.points)[0]
    assert 0.09 < away.max() <= 0.1 + LEAST_CUT * edge
    assert -0.12 < trimmed.vertices[:, 2].min() < 0
    assert trimmed.vertices[:, 2].max() == ball.vertices[:, 2].max()
    assert trimmed.normals is not None
    arms = trimmed.vertices / np.linalg.norm(trimmed.vertices, axis=1, keepdims=True)
    np.testing.assert_allclose(trimmed.normals, arms, atol=1e-3)


def test_a_trimmed_border_is_smooth(ball: Mesh) -> None:
    """It runs where the distance says, through the faces, and leaves no slivers."""
    pole = np.array([[0.0, 0, 1]])
    trimmed = trim(ball, pole, 1.0)
    rim = trimmed.vertices[boundary_vertices(trimmed)]
    edge = np.linalg.norm(np.ptp(ball.vertices[ball.faces], axis=1), axis=1).max()
    assert len(rim) > 20
    assert np.abs(np.linalg.norm(rim - pole, axis=1) - 1).max() < LEAST_CUT * edge
    assert smallest_angle(trimmed) > 0.1 * smallest_angle(ball)
    whole = mesh_health(trimmed)
    assert (whole["oriented"], whole["components"], whole["collapsed_faces"]) == (True, 1, 0)
    assert whole["euler_number"] == 1
    # A cap of height h has the area 2πh.
    corners = trimmed.vertices[trimmed.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(np.linalg.norm(across, axis=1).sum() / 2, np.pi, rtol=0.02)
    assert (np.einsum("fi,fi->f", across, corners.mean(1)) > 0).all()


def boundary_vertices(mesh: Mesh) -> np.ndarray:
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), 1
    )
    once, counts = np.unique(edges, axis=0, return_counts=True)
    return np.unique(once[counts == 1])


def smallest_angle(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, -1, axis=1) - corners
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    cosines = -np.einsum("fki,fki->fk", sides, np.roll(sides, 1, axis=1))
    return float(np.arccos(np.clip(cosines, -1, 1)).min())


def test_a_wide_trim_removes_nothing(ball: Mesh, half_scan: PointCloud) -> None:
    trimmed = trim(ball, half_scan.points, 10.0)
    np.testing.assert_array_equal(trimmed.faces, ball.faces)
    np.testing.assert_array_equal(trimmed.vertices, ball.vertices)


@pytest.mark.parametrize("distance", [0.0, 1e-9])
def test_a_trim_that_would_leave_nothing_is_refused(
    distance: float, ball: Mesh, half_scan: PointCloud
) -> None:
    with pytest.raises(InputError) as caught:
        trim(ball, half_scan.points, distance)
    assert caught.value.code == "trim_removes_all"


@pytest.mark.parametrize(("unit", "shift"), [(1.0, 0.0), (1e-6, 0.0), (1.0, 1e7), (1e4, 0.0)])
def test_decimation_reaches_its_count_and_stays_on_the_surface(
    unit: float, shift: float, ball: Mesh
) -> None:
    moved = dataclasses.replace(ball, vertices=shift + unit * ball.vertices)
    reduced = decimate(moved, 800)
    health = mesh_health(reduced)
    assert 700 <= health["faces"] <= 800
    assert health["watertight"]
    assert health["outward"]
    arms = (reduced.vertices - shift) / unit
    radius = np.linalg.norm(arms, axis=1)
    assert np.abs(radius - 1).max() < 0.02
    assert reduced.normals is not None
    cosine = np.einsum("vi,vi->v", reduced.normals, arms / radius[:, None])
    assert cosine.min() > 0.98


def test_vertex_normals_weigh_faces_by_their_area() -> None:
    """At the corner of an L the larger face has the larger say."""
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    found = vertex_normals(vertices, faces)
    np.testing.assert_allclose(found[1], [0, 0, 1], atol=1e-7)
    np.testing.assert_allclose(found[3], [1, 0, 0], atol=1e-7)
    np.testing.assert_allclose(found[0], np.array([1, 0, 2]) / np.sqrt(5), atol=1e-7)


def test_colours_and_scalars_come_from_the_nearest_point(ball: Mesh, half_scan: PointCloud) -> None:
    top = ball.vertices[:, 2] > 0.2
    found = carry_attributes(ball, half_scan)
    assert found.colors is not None
    assert found.colors.dtype == np.uint8
    np.testing.assert_allclose(found.attributes["height"][top], ball.vertices[top, 2], atol=0.05)
    np.testing.assert_allclose(found.colors[top, 0], 255 * ball.vertices[top, 2], atol=13)
    assert found.attributes["height"].shape == (len(ball.vertices),)


def test_a_scan_s_own_confidence_is_kept_beside_that_of_the_surface(ball: Mesh) -> None:
    own = dataclasses.replace(ball, attributes={"Confidence": ball.vertices[:, 0]})
    found = with_confidence(own, ball.vertices[:, 1]).attributes
    assert list(found) == ["confidence", "scan_Confidence"]
    np.testing.assert_array_equal(found["confidence"], ball.vertices[:, 1])
    np.testing.assert_array_equal(found["scan_Confidence"], ball.vertices[:, 0])


def test_nothing_is_done_that_was_not_asked_for(ball: Mesh) -> None:
    bare = uniform_scan(sphere(), 100)
    assert finish_mesh(ball, bare, ReconstructionConfig()) is ball
    assert finish_mesh(ball, bare, ReconstructionConfig(decimate=10**6)) is ball


def test_a_mesh_may_be_trimmed_decimated_and_coloured_at_once(
    ball: Mesh, half_scan: PointCloud
) -> None:
    found = finish_mesh(ball, half_scan, ReconstructionConfig(trim=0.1, decimate=500))
    assert len(found.faces) <= 500
    assert mesh_health(found)["boundary_edges"] > 0
    assert found.vertices[:, 2].min() > -0.2
    assert found.colors is not None
    assert len(found.colors) == len(found.attributes["height"]) == len(found.vertices)
    assert found.vertices.dtype == np.float64
    assert found.faces.dtype == np.int32
