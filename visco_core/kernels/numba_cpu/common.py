"""What several compiled kernels share. The constants are those of ``visco_core.kernels``."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BLOCK = 4096
ROW, FREE = 1, 2


@njit(cache=True)
def in_order(parts):
    """Their sum; ``parts.sum()`` would be split among the threads."""
    total = 0.0
    for part in parts:
        total += part
    return total


@njit(inline="always")
def trilinear(u, v, w, weights, gradients):
    """Weights and gradients, in voxels, of the eight corners at (u, v, w) in [0, 1]."""
    one = np.float32(1.0)
    for c in range(8):
        x = u if c & 4 else one - u
        y = v if c & 2 else one - v
        z = w if c & 1 else one - w
        weights[c] = x * y * z
        gradients[c, 0] = y * z if c & 4 else -y * z
        gradients[c, 1] = x * z if c & 2 else -x * z
        gradients[c, 2] = x * y if c & 1 else -x * y


@njit(inline="always")
def corners_above(i, neighbours, corners):
    """The voxel's eight nodes above node i; False where one is missing."""
    missing = neighbours.shape[0]
    corners[0] = i
    for c in range(1, 8):
        if c & 1:
            low, axis = c - 1, 5
        elif c & 2:
            low, axis = c - 2, 3
        else:
            low, axis = c - 4, 1
        corners[c] = neighbours[corners[low], axis]
        if corners[c] == missing:
            return False
    return True


def along_axes(kernel, values, side):
    """Applies a middle-axis kernel to each axis of a cube, growing or shrinking it to ``side``.

    The last axis, which is the slowest since its rows are single numbers, goes where it is short.
    """
    for axis in (2, 1, 0) if side > len(values) else (0, 1, 2):
        shape = (*values.shape[:axis], side, *values.shape[axis + 1 :])
        out = np.empty(shape, np.float32)
        before, after = math.prod(shape[:axis]), math.prod(shape[axis + 1 :])
        kernel(values.reshape(before, -1, after), out.reshape(before, side, after))
        values = out
    return values
