"""Synthetic scans without a scanner: points drawn evenly from a known surface."""

from __future__ import annotations

import numpy as np

from visco_core.gallery.damage import stream, tilt_normals
from visco_core.gallery.shape import Shape
from visco_core.metrics import sample_surface
from visco_core.pointcloud import PointCloud
from visco_core.result import Mesh


def uniform_scan(
    surface: Shape | Mesh,
    count: int,
    *,
    noise: float = 0.0,
    normal_noise: float = 0.0,
    smooth: bool = False,
    seed: int = 0,
) -> PointCloud:
    """``count`` points, uniform by area, with the surface's normals.

    noise: std of the Gaussian displacement along each axis, a fraction of the diagonal of the
    surface's box; normal_noise: std of the normals' tilt in degrees; smooth: of a mesh, blend the
    normals of its vertices instead of taking its faces'.
    """
    if isinstance(surface, Shape):
        points = surface.sample(count, seed)
        normals, diagonal = surface.normal(points), surface.diagonal
    else:
        points, normals = sample_surface(surface, count, seed, smooth=smooth)
        diagonal = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    rng = stream(seed, "noise")
    points = points + noise * diagonal * rng.standard_normal(points.shape)
    if normal_noise:
        normals = tilt_normals(normals, normal_noise, rng)
    return PointCloud(points, normals.astype(np.float32))
