"""What goes wrong with scans: each function returns a worse copy of a point cloud."""

from __future__ import annotations

import dataclasses

import numpy as np

from visco_core.pointcloud import PointCloud


def tilt_normals(normals: np.ndarray, degrees: float, rng: np.random.Generator) -> np.ndarray:
    """Unit normals (P, 3) turned about random axes by angles normal around 0, std ``degrees``."""
    angle = np.radians(degrees) * rng.standard_normal((len(normals), 1))
    across = np.cross(normals, random_directions(len(normals), rng))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return np.cos(angle) * normals + np.sin(angle) * across


def flip_normals(cloud: PointCloud, fraction: float, seed: int = 0) -> PointCloud:
    """A random ``fraction`` of the normals points the wrong way."""
    if cloud.normals is None:
        raise ValueError("a cloud without normals has none to flip")
    wrong = stream(seed, "flip").random(len(cloud)) < fraction
    normals = np.where(wrong[:, None], -cloud.normals, cloud.normals)
    return dataclasses.replace(cloud, normals=normals)


def add_outliers(cloud: PointCloud, fraction: float, seed: int = 0) -> PointCloud:
    """``fraction`` more points, uniform in the cloud's box grown by a tenth on every side."""
    rng = stream(seed, "outliers")
    count = round(fraction * len(cloud))
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    margin = 0.1 * (high - low)
    stray = rng.uniform(low - margin, high + margin, (count, 3))
    normals, colors = cloud.normals, cloud.colors
    if normals is not None:
        normals = np.concatenate([normals, random_directions(count, rng).astype(normals.dtype)])
    if colors is not None:
        colors = np.concatenate([colors, np.full((count, 3), 128, dtype=colors.dtype)])
    return PointCloud(np.concatenate([cloud.points, stray]), normals, colors)


def vary_density(cloud: PointCloud, ratio: float, seed: int = 0) -> PointCloud:
    """Thinned along the longest axis, until the far end is ``ratio`` times sparser."""
    extent = np.ptp(cloud.points, axis=0)
    axis = int(extent.argmax())
    along = (cloud.points[:, axis] - cloud.points[:, axis].min()) / max(extent[axis], 1e-300)
    keep = stream(seed, "density").random(len(cloud)) < ratio**-along
    return cloud.select(keep)


def subsample(cloud: PointCloud, count: int, seed: int = 0) -> PointCloud:
    """``count`` random points in their old order; all where there are no more."""
    if count >= len(cloud):
        return cloud
    chosen = stream(seed, "subsample").choice(len(cloud), count, replace=False)
    return cloud.select(np.sort(chosen))


def stream(seed: int, purpose: str) -> np.random.Generator:
    """Random numbers of their own for each purpose.

    Surfaces are sampled face by face in order; the same numbers once more would thin or flip whole
    regions instead of single points.
    """
    return np.random.default_rng([seed, *purpose.encode()])


def random_directions(count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors (count, 3), uniform over the sphere."""
    vectors = rng.standard_normal((count, 3))
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
