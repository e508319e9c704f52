"""Compiled kernels of what the starting field is made of."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import along_axes, trilinear


@njit(fastmath=True, cache=True)
def splat(points, vectors, cells):
    width = vectors.shape[1]
    out = np.zeros((width + 1, cells, cells, cells), np.float32)
    w = np.empty(8, np.float32)
    g = np.empty((8, 3), np.float32)
    for p in range(points.shape[0]):
        x = points[p, 0] * cells - np.float32(0.5)
        y = points[p, 1] * cells - np.float32(0.5)
        z = points[p, 2] * cells - np.float32(0.5)
        i = int(np.floor(x))
        j = int(np.floor(y))
        k = int(np.floor(z))
        trilinear(np.float32(x - i), np.float32(y - j), np.float32(z - k), w, g)
        for c in range(8):
            a = (i + (c >> 2)) % cells
            b = (j + (c >> 1 & 1)) % cells
            d = (k + (c & 1)) % cells
            for v in range(width):
                out[v, a, b, d] += w[c] * vectors[p, v]
            out[width, a, b, d] += w[c]
    return out


@njit(inline="always")
def _lower_envelope(line, apex, border, halves, out):
    """out[i] = min over j of line[j] + (i − j)²; ``line`` is 1e20 where there is no parabola.

    halves[d] = 1 / 2d.
    """
    n = line.shape[0]
    k = -1
    for j in range(n):
        if line[j] >= 1e20:
            continue
        height = line[j] + j * j
        start = -np.inf
        while k >= 0:
            v = apex[k]
            start = (height - (line[v] + v * v)) * halves[j - v]
            if start > border[k]:
                break
            k -= 1
        if k < 0:
            start = -np.inf
        k += 1
        apex[k] = j
        border[k] = start
    if k < 0:
        out[:] = 1e20
        return
    last = k
    k = 0
    for i in range(n):
        while k < last and border[k + 1] < i:
            k += 1
        out[i] = line[apex[k]] + (i - apex[k]) ** 2


TILE = 16
"""Lines along a slow axis that are turned at a time, so that what is fetched is used."""


@njit(parallel=True, cache=True)
def _distance_along(values, out):
    """Along the middle axis of (A, n, B)."""
    before, n, after = values.shape
    tiles = (after + TILE - 1) // TILE
    halves = np.empty(n)
    halves[1:] = 0.5 / np.arange(1, n)
    for task in prange(before * tiles):
        a, first = task // tiles, task % tiles * TILE
        width = min(TILE, after - first)
        lines, found = np.empty((width, n)), np.empty((width, n))
        border, apex = np.empty(n), np.empty(n, np.int64)
        for j in range(n):
            for b in range(width):
                lines[b, j] = values[a, j, first + b]
        for b in range(width):
            _lower_envelope(lines[b], apex, border, halves, found[b])
        for j in range(n):
            for b in range(width):
                out[a, j, first + b] = found[b, j]


def squared_distance(region):
    start = np.where(region, np.float32(1e20), np.float32(0))
    return along_axes(_distance_along, start, len(region))
