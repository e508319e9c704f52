"""Compiled kernels of the viscosity loss: its rows, their transpose and the diagonal.

Within a run of free nodes the neighbours on every side are runs too, so the inner loops are plain
strides that the compiler vectorises. Their indices are unsigned: numba would test signed ones for
being negative.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import ROW, in_order

RUNS = 64
"""How many runs make a block of a sum."""


@njit(inline="always")
def _run(runs, q):
    """Its first node, its end, and the way from a node to its neighbours −x, +x, −y, +y."""
    return (
        np.uint64(runs[q, 0]),
        np.uint64(runs[q, 1]),
        np.uint64(runs[q, 2]),
        np.uint64(runs[q, 3]),
        np.uint64(runs[q, 4]),
        np.uint64(runs[q, 5]),
    )


@njit(parallel=True, fastmath=True, cache=True)
def linearise(values, runs, half_inverse, laplace, slopes, rows):
    one = np.uint64(1)
    count = runs.shape[0]
    blocks = (count + RUNS - 1) // RUNS
    partial = np.zeros(blocks)
    for b in prange(blocks):
        total = 0.0
        for q in range(b * RUNS, min(count, (b + 1) * RUNS)):
            start, stop, a0, a1, b0, b1 = _run(runs, q)
            for t in range(start, stop):
                x0 = values[t + a0]
                x1 = values[t + a1]
                y0 = values[t + b0]
                y1 = values[t + b1]
                z0 = values[t - one]
                z1 = values[t + one]
                v = values[t]
                gx = (x1 - x0) * half_inverse
                gy = (y1 - y0) * half_inverse
                gz = (z1 - z0) * half_inverse
                norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                s = np.float32(1.0) if v > 0 else (np.float32(-1.0) if v < 0 else np.float32(0.0))
                k = s * half_inverse / max(norm, np.float32(1e-6))
                slopes[0, t] = k * gx
                slopes[1, t] = k * gy
                slopes[2, t] = k * gz
                r = (norm - np.float32(1.0)) * s - laplace * (
                    x0 + x1 + y0 + y1 + z0 + z1 - np.float32(6.0) * v
                )
                rows[t] = r
                total += r * r
        partial[b] = total
    return in_order(partial)


@njit(parallel=True, fastmath=True, cache=True)
def _rows(v, sx, sy, sz, runs, laplace, rows):
    one = np.uint64(1)
    for q in prange(runs.shape[0]):
        start, stop, a0, a1, b0, b1 = _run(runs, q)
        for t in range(start, stop):
            x0 = v[t + a0]
            x1 = v[t + a1]
            y0 = v[t + b0]
            y1 = v[t + b1]
            z0 = v[t - one]
            z1 = v[t + one]
            rows[t] = (
                sx[t] * (x1 - x0)
                + sy[t] * (y1 - y0)
                + sz[t] * (z1 - z0)
                - laplace * (x0 + x1 + y0 + y1 + z0 + z1 - np.float32(6.0) * v[t])
            )


def viscosity_rows(v, slopes, runs, laplace, rows):
    _rows(v, slopes[0], slopes[1], slopes[2], runs, laplace, rows)


@njit(parallel=True, fastmath=True, cache=True)
def _columns(rows, sx, sy, sz, runs, laplace, scale, out):
    one = np.uint64(1)
    for q in prange(runs.shape[0]):
        start, stop, a0, a1, b0, b1 = _run(runs, q)
        for t in range(start, stop):
            x0 = rows[t + a0]
            x1 = rows[t + a1]
            y0 = rows[t + b0]
            y1 = rows[t + b1]
            z0 = rows[t - one]
            z1 = rows[t + one]
            out[t] = scale * (
                sx[t + a0] * x0
                - sx[t + a1] * x1
                + sy[t + b0] * y0
                - sy[t + b1] * y1
                + sz[t - one] * z0
                - sz[t + one] * z1
                - laplace * (x0 + x1 + y0 + y1 + z0 + z1 - np.float32(6.0) * rows[t])
            )


def viscosity_columns(rows, slopes, runs, laplace, scale, out):
    _columns(rows, slopes[0], slopes[1], slopes[2], runs, laplace, scale, out)


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_diagonal(slopes, runs, flags, laplace, scale, out):
    one = np.uint64(1)
    for q in prange(runs.shape[0]):
        start, stop, a0, a1, b0, b1 = _run(runs, q)
        for t in range(start, stop):
            total = np.float32(36.0) * laplace * laplace
            for axis in range(3):
                low = t + a0 if axis == 0 else (t + b0 if axis == 1 else t - one)
                high = t + a1 if axis == 0 else (t + b1 if axis == 1 else t + one)
                if flags[low] & ROW:
                    total += (slopes[axis, low] - laplace) ** 2
                if flags[high] & ROW:
                    total += (slopes[axis, high] + laplace) ** 2
            out[t] = scale * total
