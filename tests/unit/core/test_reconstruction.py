"""From a point cloud to a mesh: where it lies, and what it keeps."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import plyfile
import pytest
from gltf_validator import validate
from runs import Record, assert_one_closed_body, config, off_sphere, voxel

from visco_core.config import LevelSchedule, LossWeights, ReconstructionConfig
from visco_core.errors import InputError
from visco_core.frame import FILL, Normalisation
from visco_core.gallery import (
    Scanner,
    box,
    bumpy_torus,
    scan,
    sphere,
    torus,
    two_bodies,
    uniform_scan,
)
from visco_core.io import read_mesh, read_points, write_mesh
from visco_core.mesh_health import mesh_health
from visco_core.metrics import nearest_distance, point_to_mesh_distance
from visco_core.normals import estimate_normals
from visco_core.pointcloud import PointCloud
from visco_core.presets import Settings, decide
from visco_core.reconstruction import reconstruct
from visco_core.result import Mesh
from visco_core.trim import LEAST_CUT


@pytest.mark.parametrize("normals", ["estimated", "none"])
def test_a_noiseless_scan_of_a_sphere_at_64_is_met_within_a_quarter_voxel(normals: Any) -> None:
    cloud = scan(sphere(), Scanner(normals=normals, points=15_000))
    result = reconstruct(cloud, ReconstructionConfig(resolution=64, device="cpu", threads=2))
    assert result.outcome.resolution == 64
    assert_one_closed_body(result.mesh)
    assert off_sphere(result) < 0.25


def test_two_levels_meet_the_sphere_and_its_normals(record: Record) -> None:
    mesh = record.result.mesh
    assert_one_closed_body(mesh)
    assert off_sphere(record.result) < 0.25
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    assert mesh.normals is not None
    assert mesh.normals.dtype == np.float32
    assert mesh.colors is None
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)
    assert np.einsum("vi,vi->v", mesh.normals, mesh.vertices).min() > 0.98


def keeping_nothing(*given: Any, **named: Any) -> Settings:
    return replace(decide(*given, **named), keeps=False)


@pytest.mark.parametrize(
    ("make", "noise", "viscosity", "instead", "share"),
    [(bumpy_torus, 0.001, 8e-4, ("reconstruction.decide", keeping_nothing), 0.85),
     (torus, 0.01, 2e-2, ("multires.KEPT_OVER", 0.0), 0.93),
     (box, 0.001, 8e-4, ("energy.STRAIGHT", 1e9), 0.88)],
    ids=["of the shape", "without the noise", "most of it at creases"],
)  # fmt: skip
def test_what_smoothing_took_from_the_shape_the_next_level_gives_back(
    make: Callable[[], Any],
    noise: float,
    viscosity: float,
    instead: tuple[str, Any],
    share: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shape = make()
    cloud = uniform_scan(shape, 60_000, noise=noise, normal_noise=9)
    smooth = ReconstructionConfig(resolution=128, weights=LossWeights(viscosity=viscosity))

    def error() -> float:
        return float(np.abs(shape.sdf(reconstruct(cloud, smooth).mesh.vertices)).mean())

    found = error()
    name, other = instead
    monkeypatch.setattr(f"visco_core.{name}", other)
    assert found < share * error()


def test_noise_counts_less_where_a_scans_own_normals_are_planes() -> None:
    points = uniform_scan(bumpy_torus(), 20_000, noise=0.002).points
    planes = estimate_normals(points).astype(np.float32)

    def viscosity(cloud: PointCloud) -> float:
        return reconstruct(cloud, config(64)).report["settings"]["weights"][0]["viscosity"]

    assert viscosity(PointCloud(points, planes)) < 0.6 * viscosity(PointCloud(points))


@pytest.mark.parametrize(("make", "bodies", "genus"), [(torus, 1, 1), (two_bodies, 2, 0)])
def test_topology_is_that_of_the_scanned_shape(
    make: Callable[[], Any], bodies: int, genus: int
) -> None:
    shape = make()
    result = reconstruct(uniform_scan(shape, 20_000), config(128))
    assert_one_closed_body(result.mesh, bodies, genus)
    off = np.abs(shape.sdf(result.mesh.vertices))
    assert off.mean() < 0.1 * voxel(result)
    assert off.max() < 1.2 * voxel(result)


def test_the_same_seed_gives_the_same_mesh_with_one_and_two_threads(
    ball: PointCloud, record: Record
) -> None:
    for threads in (1, 2):
        again = reconstruct(ball, config(threads=threads)).mesh
        np.testing.assert_array_equal(again.vertices, record.result.mesh.vertices)
        np.testing.assert_array_equal(again.faces, record.result.mesh.faces)
        np.testing.assert_array_equal(again.normals, record.result.mesh.normals)


def test_the_paper_profile_repeats_itself_and_follows_its_seed(ball: PointCloud) -> None:
    short = LevelSchedule(epochs=(1,), iterations=40, prune=3)
    runs = [
        reconstruct(ball, config(profile="paper", schedule=short, seed=seed)) for seed in (5, 5, 6)
    ]
    meshes = [run.mesh for run in runs]
    np.testing.assert_array_equal(meshes[0].vertices, meshes[1].vertices)
    assert not np.array_equal(meshes[0].vertices, meshes[2].vertices)
    # So few iterations leave the surface rough, with a handle here and there.
    health = mesh_health(meshes[0])
    assert health["watertight"]
    assert health["outward"]
    assert off_sphere(runs[0]) < 2.5
    assert {"point", "normal", "viscosity", "coarea"} <= runs[0].report["steps"][0].keys()


def test_both_backends_give_the_same_surface(ball: PointCloud) -> None:
    short = LevelSchedule(outer_steps=(1,), inner_steps=(8,))
    results = [
        reconstruct(ball, config(schedule=short, backend=name, threads=1))
        for name in ("native", "reference")
    ]
    assert [result.report["backend"] for result in results] == ["native on cpu", "reference on cpu"]
    ours, theirs = (result.mesh for result in results)
    unit = voxel(results[0])
    assert nearest_distance(ours.vertices, theirs.vertices)[0].max() < 0.05 * unit
    assert nearest_distance(theirs.vertices, ours.vertices)[0].max() < 0.05 * unit


@pytest.mark.parametrize(
    ("unit", "shift"), [(1.0, (1e7, -2e7, 5e6)), (1e-6, (0.0, 0.0, 0.0)), (1e6, (0.0, 0.0, 0.0))]
)
def test_place_and_unit_of_the_scan_do_not_change_the_shape(
    unit: float, shift: tuple[float, float, float], ball: PointCloud, record: Record
) -> None:
    moved = PointCloud(unit * ball.points + shift, ball.normals)
    result = reconstruct(moved, config())
    back = (result.mesh.vertices - shift) / unit
    assert_one_closed_body(result.mesh)
    assert voxel(result) / unit == pytest.approx(voxel(record.result), rel=1e-6)
    plain = record.result.mesh
    distance = point_to_mesh_distance(back, Mesh(plain.vertices, plain.faces))
    assert distance.max() < 0.02 * voxel(record.result)


@pytest.mark.parametrize("normals", ["estimate", "ignore"])
def test_normals_may_be_estimated_or_ignored(normals: Any, ball: PointCloud) -> None:
    """The scan's normals point inward here, which turns the body inside out when they are used."""
    inward = PointCloud(ball.points, -ball.normals)
    result = reconstruct(inward, config(normals=normals))
    assert_one_closed_body(result.mesh)
    assert off_sphere(result) < 0.4
    losses = result.report["steps"][0]
    assert (losses["normal"] == 0) == (normals == "ignore")
    assert "normals" in [phase["phase"] for phase in result.report["phases"]]


def test_normals_made_from_noisy_points_do_not_roughen_the_surface() -> None:
    """They repeat the noise of the points, so they count on the coarsest level alone."""
    cloud = uniform_scan(sphere(), 50_000, noise=0.005)
    made, held_to_them = (
        reconstruct(PointCloud(cloud.points), config(schedule=LevelSchedule(), weights=weights))
        for weights in (LossWeights(viscosity=2e-3), LossWeights(viscosity=2e-3, normal=1e-4))
    )
    assert off_sphere(made) < 0.8 * off_sphere(held_to_them)


def test_normals_that_all_point_inward_are_turned_unless_they_are_to_be_kept(
    ball: PointCloud, record: Record
) -> None:
    inward = PointCloud(ball.points, -ball.normals)
    turned, kept = (reconstruct(inward, config(normals=normals)) for normals in ("use", "keep"))
    np.testing.assert_array_equal(turned.mesh.vertices, record.result.mesh.vertices)
    assert [note for note in turned.notes if "4,000 of 4,000; normals=keep" in note]
    health = mesh_health(kept.mesh)
    assert (health["watertight"], health["outward"]) == (True, False)
    assert [
        note for note in kept.notes if "into what it encloses, as the scan's normals do" in note
    ]
    assert "normals" not in [phase["phase"] for phase in kept.report["phases"]]


def test_crop_keeps_the_surface_of_what_is_inside_the_box() -> None:
    cloud = uniform_scan(two_bodies(), 6000)
    result = reconstruct(cloud, config(crop=(-1, -0.5, -0.5, 0.05, 0.5, 0.5)))
    assert_one_closed_body(result.mesh)
    ball = np.linalg.norm(result.mesh.vertices - [-0.5, 0, 0], axis=1)
    assert np.abs(ball - 0.45).max() < 0.5 * voxel(result)


def test_a_crop_box_without_points_is_refused(ball: PointCloud) -> None:
    with pytest.raises(InputError) as caught:
        reconstruct(ball, config(crop=(5, 5, 5, 6, 6, 6)))
    assert caught.value.code == "empty_crop"


def test_trim_opens_the_mesh_where_nothing_was_scanned(ball: PointCloud) -> None:
    half = ball.select(ball.points[:, 2] > 0)
    closed = reconstruct(half, config())
    assert mesh_health(closed.mesh)["watertight"]
    opened = reconstruct(half, config(trim=0.15)).mesh
    assert mesh_health(opened)["boundary_edges"] > 100
    assert len(opened.faces) < len(closed.mesh.faces)
    # An edge of the mesh is no longer than a voxel's diagonal.
    assert nearest_distance(opened.vertices, half.points)[0].max() <= (
        0.15 + LEAST_CUT * 3**0.5 * voxel(closed)
    )
    assert nearest_distance(closed.mesh.vertices, half.points)[0].max() > 0.5
    (note,) = closed.notes
    assert re.match(r"[23]\d % of the surface lies where the scan has no points; trim=0\.", note)
    advised = float(note.split("=")[1].split()[0])
    cut = reconstruct(half, config(trim=advised))
    assert cut.notes == []
    assert -0.2 < cut.mesh.vertices[:, 2].min() < 0.02
    assert point_to_mesh_distance(half.points, cut.mesh).max() < voxel(closed)


def test_decimation_and_colours_reach_the_mesh(ball: PointCloud) -> None:
    colors = (127.5 * (ball.points + 1)).astype(np.uint8)
    warmth = ball.points[:, 2].astype(np.float32)
    cloud = replace(ball, colors=colors, scalars={"warmth": warmth})
    mesh = reconstruct(cloud, config(decimate=3000)).mesh
    assert 2900 <= len(mesh.faces) <= 3000
    assert_one_closed_body(mesh)
    assert mesh.colors is not None
    np.testing.assert_allclose(mesh.colors, 127.5 * (mesh.vertices + 1), atol=20)
    np.testing.assert_allclose(mesh.attributes["warmth"], mesh.vertices[:, 2], atol=0.15)


def test_every_vertex_of_an_opened_and_decimated_mesh_has_its_confidence(ball: PointCloud) -> None:
    half = ball.select(ball.points[:, 2] > 0)
    mesh = reconstruct(half, config(trim=0.6, decimate=3000)).mesh
    found = mesh.attributes["confidence"]
    assert found.dtype == np.float32
    assert found.shape == (len(mesh.vertices),)
    height = mesh.vertices[:, 2]
    assert found[height > 0.2].mean() > 0.8
    assert found[height < -0.3].max() < 0.2


def write_scalar_ply(path: Path, points: np.ndarray, warmth: np.ndarray) -> None:
    names = [*"xyz", "intensity", "quality"]
    columns = [*points.T, 100 * warmth, -warmth]
    rows = np.rec.fromarrays(columns, [(name, "<f4") for name in names])
    plyfile.PlyData([plyfile.PlyElement.describe(rows, "vertex")]).write(path)


def write_scalar_las(path: Path, points: np.ndarray, warmth: np.ndarray) -> None:
    las = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    las.header.scales = np.full(3, 1e-6)
    las.x, las.y, las.z = points.T
    las.intensity = (100 * warmth).astype(np.uint16)
    las.write(path)


@pytest.mark.parametrize(
    ("name", "write", "carried"),
    [
        ("scan.ply", write_scalar_ply, {"intensity": 100, "quality": -1}),
        ("scan.las", write_scalar_las, {"intensity": 100}),
    ],
)
def test_scalar_fields_of_a_scan_s_file_reach_the_vertices_in_the_mesh_s_file(
    name: str, write: Any, carried: dict[str, float], ball: PointCloud, tmp_path: Path
) -> None:
    write(tmp_path / name, ball.points, 1 + ball.points[:, 2])
    mesh = reconstruct(read_points(tmp_path / name), config(64, normals="estimate")).mesh
    for ending in ("glb", "ply"):
        write_mesh(mesh, tmp_path / f"mesh.{ending}")
        found = read_mesh(tmp_path / f"mesh.{ending}").attributes
        assert list(found) == ["confidence", *carried]
        assert np.array_equal(found["confidence"], mesh.attributes["confidence"])
        for field, factor in carried.items():
            expected = factor * (1 + mesh.vertices[:, 2])
            np.testing.assert_allclose(found[field], expected, atol=0.15 * abs(factor))
    (issues,) = validate(tmp_path / "mesh.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    assert b'"_CONFIDENCE"' in (tmp_path / "mesh.glb").read_bytes()
    assert b"property float confidence\n" in (tmp_path / "mesh.ply").read_bytes()


def test_confidence_does_not_depend_on_place_and_unit_of_the_scan(
    ball: PointCloud, record: Record
) -> None:
    moved = reconstruct(PointCloud(1e-3 * ball.points + 1e4, ball.normals), config()).mesh
    plain = record.result.mesh.attributes["confidence"]
    np.testing.assert_allclose(
        np.quantile(moved.attributes["confidence"], [0.1, 0.5, 0.9]),
        np.quantile(plain, [0.1, 0.5, 0.9]),
        atol=0.01,
    )


def plane(count: int = 2000) -> np.ndarray:
    return np.random.default_rng(0).random((count, 3)) * [1, 1, 0]


def saddle(count: int) -> np.ndarray:
    x, y, _ = plane(count).T
    return np.column_stack([x, y, (x - 0.5) ** 2 - (y - 0.5) ** 2])


def upward(count: int) -> np.ndarray:
    return np.tile(np.float32([0, 0, 1]), (count, 1))


@pytest.mark.parametrize(
    "cloud",
    [
        PointCloud(np.random.default_rng(1).random((10, 3))),
        PointCloud(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])),
        PointCloud(plane()),
        PointCloud(plane(), upward(2000)),
        PointCloud(plane(300) @ np.array([[1, 0, 1], [0, 1, 0], [0, 0, 0]]), upward(300)),
        PointCloud(saddle(3000), upward(3000)),
    ],
    ids=["ten points", "tetrahedron", "plane", "plane with normals", "slope", "saddle"],
)
def test_poor_and_open_scans_give_a_closed_mesh_near_their_points(cloud: PointCloud) -> None:
    result = reconstruct(cloud, config(128))
    mesh = result.mesh
    assert len(mesh.faces) > 0
    assert np.isfinite(mesh.vertices).all()
    health = mesh_health(mesh)
    assert health["watertight"]
    assert health["outward"]
    off = point_to_mesh_distance(cloud.points, mesh)
    assert np.median(off) < voxel(result)


@pytest.mark.parametrize(
    ("points", "code"),
    [
        (np.zeros((0, 3)), "no_points"),
        (np.full((5, 3), np.nan), "no_points"),
        (np.ones((1, 3)), "too_few_points"),
        (np.ones((90, 3)), "too_few_points"),
        (np.outer(np.arange(50.0), [1, 2, 3]), "collinear_points"),
    ],
)
def test_what_has_no_surface_is_refused(points: np.ndarray, code: str) -> None:
    with pytest.raises(InputError) as caught:
        reconstruct(PointCloud(points), config())
    assert caught.value.code == code


def test_a_scan_of_any_size_fills_the_same_share_of_the_cube() -> None:
    points = np.random.default_rng(0).uniform(-3, 5, (1000, 3)) * [1, 0.5, 0.1] + 1e7
    frame = Normalisation.of(points)
    cube = frame.to_cube(points)
    assert np.ptp(cube, axis=0).max() == pytest.approx(FILL)
    np.testing.assert_allclose((cube.min(0) + cube.max(0)) / 2, 0.5, atol=1e-9)
    np.testing.assert_allclose(frame.to_scan(cube), points, rtol=1e-15)


def test_more_viscosity_smooths_a_noisy_scan() -> None:
    cloud = uniform_scan(sphere(), 4000, noise=0.01)
    rough, smooth = (
        off_sphere(reconstruct(cloud, config(64, weights=LossWeights(viscosity=weight))))
        for weight in (1e-6, 1e-3)
    )
    assert smooth < 0.7 * rough
