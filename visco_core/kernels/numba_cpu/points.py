"""Compiled kernels of the point and normal losses, gathered per voxel."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import BLOCK, FREE, in_order, trilinear


@njit(parallel=True, fastmath=True, cache=True)
def _point_system(
    local, normals, starts, resolution, point_weight, normal_weight, matrices, vectors
):
    for m in prange(starts.shape[0] - 1):
        w = np.empty(8, np.float32)
        g = np.empty((8, 3), np.float32)
        for k in range(starts[m], starts[m + 1]):
            trilinear(local[k, 0], local[k, 1], local[k, 2], w, g)
            for r in range(8):
                total = np.float32(0.0)
                for a in range(3):
                    g[r, a] *= resolution
                    total += g[r, a] * normals[k, a]
                vectors[m, r] += normal_weight * total
            for r in range(8):
                for c in range(8):
                    alike = g[r, 0] * g[c, 0] + g[r, 1] * g[c, 1] + g[r, 2] * g[c, 2]
                    matrices[m, r, c] += point_weight * w[r] * w[c] + normal_weight * alike


def point_system(local, normals, starts, resolution, point_weight, normal_weight):
    voxels = len(starts) - 1
    matrices, vectors = np.zeros((voxels, 8, 8), np.float32), np.zeros((voxels, 8), np.float32)
    _point_system(
        local,
        normals,
        starts,
        np.float32(resolution),
        np.float32(point_weight),
        np.float32(normal_weight),
        matrices,
        vectors,
    )
    return matrices, vectors


@njit(parallel=True, fastmath=True, cache=True)
def point_sums(values, corners, local, normals, starts, resolution):
    voxels = starts.shape[0] - 1
    blocks = (voxels + BLOCK - 1) // BLOCK
    partial = np.zeros((blocks, 2))
    for b in prange(blocks):
        w = np.empty(8, np.float32)
        g = np.empty((8, 3), np.float32)
        square = 0.0
        mismatch = 0.0
        for m in range(b * BLOCK, min(voxels, (b + 1) * BLOCK)):
            for k in range(starts[m], starts[m + 1]):
                trilinear(local[k, 0], local[k, 1], local[k, 2], w, g)
                value = np.float32(0.0)
                for c in range(8):
                    value += w[c] * values[corners[m, c]]
                square += value * value
                for a in range(3):
                    slope = np.float32(0.0)
                    for c in range(8):
                        slope += g[c, a] * values[corners[m, c]]
                    mismatch += (slope * resolution - normals[k, a]) ** 2
        partial[b, 0] = square
        partial[b, 1] = mismatch
    return in_order(partial[:, 0]), in_order(partial[:, 1])


@njit(parallel=True, fastmath=True, cache=True)
def point_matvec(v, corners, matrices, slabs, flags, out):
    count = slabs.shape[0] - 1
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            x = np.empty(8, np.float32)
            for m in range(slabs[slab], slabs[slab + 1]):
                for c in range(8):
                    x[c] = v[corners[m, c]]
                for r in range(8):
                    node = corners[m, r]
                    if flags[node] & FREE:
                        total = np.float32(0.0)
                        for c in range(8):
                            total += matrices[m, r, c] * x[c]
                        out[node] += total


@njit(parallel=True, fastmath=True, cache=True)
def scatter(per_corner, corners, slabs, flags, out):
    count = slabs.shape[0] - 1
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            for m in range(slabs[slab], slabs[slab + 1]):
                for c in range(8):
                    if flags[corners[m, c]] & FREE:
                        out[corners[m, c]] += per_corner[m, c]
