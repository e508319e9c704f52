"""Normals made of planes are told from a scanner's own, and follow the surface to its rims."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from visco_core import reconstruct
from visco_core.config import ReconstructionConfig
from visco_core.gallery import SHAPES, uniform_scan
from visco_core.pointcloud import PointCloud
from visco_core.rims import are_planes, straighten_rims


def sphere_with_hole(count: int = 30_000, noise: float = 0.002) -> PointCloud:
    """A unit sphere without what is within 0.5 radians of its pole, and its exact normals."""
    random = np.random.default_rng(0)
    normals = random.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals[normals[:, 2] < np.cos(0.5)]
    points = normals * (1 + noise * random.standard_normal((len(normals), 1)))
    return PointCloud(points, normals.astype(np.float32))


def with_planes(cloud: PointCloud, neighbours: int) -> PointCloud:
    """The normals of planes through each point's neighbours, on the side of the exact ones."""
    assert cloud.normals is not None
    near = cloud.points[KDTree(cloud.points).query(cloud.points, neighbours)[1]]
    away = near - near.mean(1, keepdims=True)
    planes = np.linalg.eigh(np.einsum("ski,skj->sij", away, away))[1][:, :, 0]
    sides = np.sign(np.einsum("pi,pi->p", planes, cloud.normals))
    return replace(cloud, normals=(planes * sides[:, None]).astype(np.float32))


def degrees_off(normals: np.ndarray, cloud: PointCloud, where: np.ndarray) -> float:
    assert cloud.normals is not None
    cosine = np.einsum("pi,pi->p", normals, cloud.normals)
    return float(np.degrees(np.arccos(np.clip(cosine[where], -1, 1))).mean())


@pytest.mark.parametrize("neighbours", [8, 12, 30])
def test_normals_made_of_planes_are_known(neighbours: int):
    planes = with_planes(uniform_scan(SHAPES["bumpy_torus"]().mesh(100), 10_000), neighbours)
    assert planes.normals is not None
    assert are_planes(planes.points, planes.normals)


@pytest.mark.parametrize("degrees", [0, 6])
@pytest.mark.parametrize("shape", ["bumpy_torus", "box"])
def test_a_scanners_own_normals_are_not_taken_for_planes(shape: str, degrees: float):
    cloud = uniform_scan(SHAPES[shape]().mesh(100), 10_000, normal_noise=degrees)
    assert cloud.normals is not None
    assert not are_planes(cloud.points, cloud.normals)


def test_plane_normals_lean_at_the_rim_of_a_hole_and_are_straightened():
    cloud = sphere_with_hole()
    planes = with_planes(cloud, 16).normals
    assert planes is not None
    straight = straighten_rims(cloud.points, planes)
    rim = cloud.points[:, 2] > np.cos(0.54) * np.linalg.norm(cloud.points, axis=1)
    assert degrees_off(straight, cloud, rim) < 0.5 * degrees_off(planes, cloud, rim)
    far = cloud.points[:, 2] < 0
    assert np.array_equal(straight[far], planes[far])


def test_a_hole_is_filled_as_with_exact_normals():
    cloud = sphere_with_hole(3_000)

    def error_of_cap(scan: PointCloud) -> float:
        vertices = reconstruct(scan, ReconstructionConfig(resolution=64)).mesh.vertices
        cap = vertices[vertices[:, 2] > np.cos(0.5)]
        return float(np.abs(np.linalg.norm(cap, axis=1) - 1).mean())

    exact = error_of_cap(cloud)
    assert error_of_cap(with_planes(cloud, 16)) == pytest.approx(exact, rel=0.05)
    assert error_of_cap(replace(cloud, normals=None)) == pytest.approx(exact, rel=0.05)
