"""Scans as GLB, for viewers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from gltf_validator import validate

from visco_core.io.glb import write_points_glb
from visco_core.pointcloud import PointCloud

UTM = np.array([5.1e6, 1e7, 120.0])


@pytest.fixture
def cloud() -> PointCloud:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(50, 3)) * 20 + UTM
    return PointCloud(points, None, rng.integers(0, 256, (50, 3)).astype(np.uint8))


def write(cloud: PointCloud, path: Path) -> Path:
    with path.open("wb") as file:
        write_points_glb(cloud, file, up_axis="y")
    return path


def test_the_khronos_validator_finds_nothing_wrong_with_points(
    cloud: PointCloud, tmp_path: Path
) -> None:
    plain = write(PointCloud(cloud.points), tmp_path / "plain.glb")
    colored = write(cloud, tmp_path / "colored.glb")
    for report in validate(plain, colored):
        assert (report["numErrors"], report["numWarnings"]) == (0, 0), report["messages"]


def test_trimesh_puts_the_points_where_the_scan_is(cloud: PointCloud, tmp_path: Path) -> None:
    scene = trimesh.load_scene(write(cloud, tmp_path / "scan.glb"))
    (points,) = scene.dump()
    assert np.abs(points.vertices - cloud.points).max() < 1e-4
