"""The point and normal losses, gathered per voxel."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def point_system(local, normals, starts, resolution, point_weight, normal_weight):
    voxels = len(starts) - 1
    matrices, vectors = np.zeros((voxels, 5, 8), np.float32), np.zeros((voxels, 8), np.float32)
    weights = resolution, point_weight, normal_weight
    library.point_system(local, normals, starts, voxels, *weights, matrices, vectors)
    return matrices, vectors


def point_sums(values, corners, local, normals, starts, resolution):
    sums = np.empty(2)
    samples = corners, local, normals, starts, len(starts) - 1
    library.point_sums(values, *samples, resolution, sums)
    return float(sums[0]), float(sums[1])


def point_matvec(v, corners, matrices, slabs, flags, out):
    library.point_matvec(v, corners, matrices, slabs, len(slabs) - 1, flags, out)


def scatter(per_corner, corners, slabs, flags, out):
    library.scatter(per_corner, corners, slabs, len(slabs) - 1, flags, out)
