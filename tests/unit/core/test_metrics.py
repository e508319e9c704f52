"""Distances between surfaces whose distance is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from visco_core import gallery, metrics
from visco_core.errors import InputError
from visco_core.mesh_health import mesh_health
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh


def patch(height: float, size: float = 1.0) -> Mesh:
    """A square in the plane z = height, two triangles, facing up."""
    corners = np.array([[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]])
    vertices = np.column_stack([corners, np.full(4, height)])
    return Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))


def tetrahedron() -> Mesh:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
    return Mesh(vertices, faces)


def joined(*meshes: Mesh) -> Mesh:
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=False)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def test_surface_samples_are_uniform_by_area() -> None:
    small, large = patch(0.0), patch(1.0, size=3.0)
    points, _ = metrics.sample_surface(joined(small, large), 20_000)
    assert (points[:, 2] == 1.0).mean() == pytest.approx(0.9, abs=0.01)
    inside = points[points[:, 2] == 0.0][:, :2]
    assert np.allclose(np.histogram2d(*inside.T, bins=2)[0] / len(inside), 0.25, atol=0.03)


def test_sample_normals_are_the_faces_own() -> None:
    _, normals = metrics.sample_surface(patch(0.0), 10)
    assert np.allclose(normals, [0.0, 0.0, 1.0])


def test_distances_between_small_sets_of_points_are_counted_by_hand() -> None:
    first = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    second = np.array([[0.0, 0.0, 2.0]])
    there = 0.5 * (2.0 + np.sqrt(5.0))
    assert metrics.chamfer_distance(first, second) == pytest.approx(0.5 * (there + 2.0))
    assert metrics.hausdorff_distance(first, second) == pytest.approx(np.sqrt(5.0))


def test_f_score_is_the_harmonic_mean_of_precision_and_recall() -> None:
    to_result, to_truth = np.array([0.0, 2.0]), np.array([0.0, 0.0, 0.0, 2.0])
    assert metrics.f_score(to_result, to_truth, 1.0) == pytest.approx(2 * 0.5 * 0.75 / 1.25)
    assert metrics.f_score(to_result + 5.0, to_truth + 5.0, 1.0) == 0.0


def test_parallel_patches_are_their_offset_apart() -> None:
    result = metrics.evaluate(patch(0.25), patch(0.0), samples=20_000)
    assert result["d_C"] == pytest.approx(0.25, rel=1e-3)
    exact = result["point_to_triangle"]
    assert exact["gt_to_mesh"]["mean"] == pytest.approx(0.25)
    assert exact["mesh_to_gt"]["max"] == pytest.approx(0.25)
    assert result["normal_consistency"] == pytest.approx(1.0)
    assert result["f_score"]["value"] == 0.0


def test_concentric_spheres_are_the_difference_of_their_radii_apart() -> None:
    inner, outer = gallery.sphere(1.0).mesh(32), gallery.sphere(1.2).mesh(32)
    result = metrics.evaluate(inner, outer, samples=10_000)
    assert result["d_C"] == pytest.approx(0.2, rel=0.02)
    assert result["d_H"] == pytest.approx(0.2, rel=0.2)
    assert result["point_to_triangle"]["gt_to_mesh"]["mean"] == pytest.approx(0.2, rel=0.005)


def test_a_missing_part_shows_from_the_truth_and_an_extra_one_from_the_mesh() -> None:
    near, far = patch(0.0), patch(5.0)
    missing = metrics.evaluate(near, joined(near, far), samples=5000)["point_to_triangle"]
    extra = metrics.evaluate(joined(near, far), near, samples=5000)["point_to_triangle"]
    assert missing["gt_to_mesh"]["max"] == pytest.approx(5.0)
    assert missing["mesh_to_gt"]["max"] == pytest.approx(0.0, abs=1e-9)
    assert extra["mesh_to_gt"]["mean"] == pytest.approx(2.5, rel=0.05)


def test_scan_distance_is_one_sided() -> None:
    scan = PointCloud(np.array([[0.5, 0.5, 0.1], [0.5, 0.5, -0.3]]))
    result = metrics.evaluate(patch(0.0), patch(0.0), scan, samples=20_000)
    assert result["point_to_triangle"]["scan_to_mesh"] == {
        "mean": pytest.approx(0.2),
        "max": pytest.approx(0.3),
    }
    assert result["one_sided"]["scan_to_mesh"]["max"] == pytest.approx(0.3, rel=1e-2)


def test_sparse_ground_truth_points_give_only_what_they_can() -> None:
    truth = PointCloud(np.array([[0.5, 0.5, 0.5]]))
    result = metrics.evaluate(patch(0.0), truth, samples=1000)
    assert result["d_C"] is None
    assert result["one_sided"]["mesh_to_gt"] is None
    assert result["point_to_triangle"]["gt_to_mesh"]["mean"] == pytest.approx(0.5)


def test_dense_ground_truth_points_give_a_two_sided_distance() -> None:
    truth = PointCloud(metrics.sample_surface(patch(0.5), 100_000)[0])
    result = metrics.evaluate(patch(0.0), truth, samples=20_000)
    assert result["d_C"] == pytest.approx(0.5, rel=1e-3)
    assert result["normal_consistency"] is None


def test_evaluation_is_json_and_repeats_with_its_seed() -> None:
    first, second = (
        metrics.evaluate(patch(0.0), patch(0.1), samples=2000, seed=7) for _ in range(2)
    )
    assert json.loads(json.dumps(first)) == second
    assert metrics.evaluate(patch(0.0), patch(0.1), samples=2000, seed=8) != first


def test_mesh_and_truth_are_never_sampled_at_the_same_points() -> None:
    assert metrics.evaluate(patch(0.0), patch(0.0), samples=2000)["d_C"] > 1e-3


def test_a_mesh_without_surface_is_refused() -> None:
    point = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], dtype=np.int32))
    with pytest.raises(InputError, match="no surface") as caught:
        metrics.evaluate(point, patch(0.0))
    assert caught.value.code == "empty_mesh"


def test_occupancy_iou_of_two_balls_is_the_ratio_of_their_volumes() -> None:
    points = np.random.default_rng(0).uniform(-1.3, 1.3, (40_000, 3))
    labels = np.linalg.norm(points, axis=1) < 1.0
    ball = gallery.sphere(0.8).mesh(64)
    assert metrics.occupancy_iou(ball, points, labels) == pytest.approx(0.8**3, abs=0.02)


@pytest.mark.realdata
@pytest.mark.parametrize(("name", "floor"), [("anchor", 0.062), ("dc", 0.054)])
def test_perfect_result_scores_the_floor_of_the_protocol(
    realdata: Path, name: str, floor: float
) -> None:
    truth = read_mesh(realdata / "srb" / "gt" / f"{name}_gt_mesh.ply")
    # Uniform samples lie at a distance that shrinks with the root of their number.
    result = metrics.evaluate(truth, truth, samples=250_000)
    assert result["d_C"] / 2.0 == pytest.approx(floor, abs=0.001)
    assert result["point_to_triangle"]["mesh_to_gt"]["max"] < 1e-9


@pytest.mark.realdata
def test_occupancy_labels_agree_with_the_ground_truth(realdata: Path) -> None:
    truth = read_mesh(realdata / "srb" / "gt" / "dc_gt_mesh.ply")
    stored = np.load(realdata / "srb" / "gt" / "dc_occ_points.npz")
    labels = np.unpackbits(stored["occupancies"])[:100_000].astype(bool)
    assert metrics.occupancy_iou(truth, stored["points"], labels) > 0.998


def read_mesh(path: Path) -> Mesh:
    import trimesh

    mesh = trimesh.load(path, process=False)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces).astype(np.int32))


def test_a_tetrahedron_is_healthy() -> None:
    health = mesh_health(tetrahedron())
    assert health["watertight"]
    assert health["outward"]
    assert health["volume"] == pytest.approx(1.0 / 6.0)
    assert (health["euler_number"], health["genus"], health["components"]) == (2, 0, 1)
    assert json.loads(json.dumps(health)) == health


def test_an_inside_out_mesh_is_watertight_but_not_outward() -> None:
    mesh = tetrahedron()
    health = mesh_health(Mesh(mesh.vertices, mesh.faces[:, ::-1]))
    assert health["watertight"]
    assert health["outward"] is False


def test_a_removed_face_leaves_its_three_edges_as_boundary() -> None:
    mesh = tetrahedron()
    health = mesh_health(Mesh(mesh.vertices, mesh.faces[1:]))
    assert health["boundary_edges"] == 3
    assert not health["watertight"]
    assert health["outward"] is None
    assert health["genus"] == 0


def test_a_turned_face_is_not_oriented() -> None:
    mesh = tetrahedron()
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    health = mesh_health(Mesh(mesh.vertices, faces))
    assert not health["oriented"]
    assert health["nonmanifold_vertices"] == 0
    assert health["genus"] is None


def test_three_faces_at_an_edge_are_not_manifold() -> None:
    vertices = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], dtype=np.int32)
    assert mesh_health(Mesh(vertices, faces))["nonmanifold_edges"] == 1


def test_two_solids_that_share_a_corner_meet_in_a_nonmanifold_vertex() -> None:
    first, second = tetrahedron(), tetrahedron()
    mesh = joined(first, Mesh(-second.vertices, second.faces[:, ::-1]))
    faces = np.where(mesh.faces == 4, 0, mesh.faces)
    health = mesh_health(Mesh(mesh.vertices, faces))
    assert health["nonmanifold_vertices"] == 1
    assert health["unused_vertices"] == 1
    assert health["watertight"]
    assert health["components"] == 2
    assert health["genus"] == 0


def test_a_tube_has_two_boundary_loops_and_no_genus() -> None:
    angle = 2.0 * np.pi * np.arange(6) / 6
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([ring, np.full(6, z)]) for z in (0.0, 1.0)])
    here, there = np.arange(6), (np.arange(6) + 1) % 6
    faces = np.concatenate(
        [np.stack([here, there, here + 6], 1), np.stack([there, there + 6, here + 6], 1)]
    )
    health = mesh_health(Mesh(vertices, faces.astype(np.int32)))
    assert (health["boundary_edges"], health["euler_number"], health["genus"]) == (12, 0, 0)
    assert health["oriented"]


def test_collapsed_faces_are_counted_and_left_out() -> None:
    mesh = tetrahedron()
    faces = np.concatenate([mesh.faces, [[0, 0, 1]]]).astype(np.int32)
    health = mesh_health(Mesh(mesh.vertices, faces))
    assert health["collapsed_faces"] == 1
    assert health["watertight"]


def test_a_mesh_without_faces_has_no_health_to_speak_of() -> None:
    health = mesh_health(Mesh(np.zeros((2, 3)), np.zeros((0, 3), dtype=np.int32)))
    assert health["components"] == 0
    assert not health["watertight"]
