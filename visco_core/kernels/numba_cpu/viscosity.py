"""Compiled kernels of the viscosity loss: its rows, their transpose and the diagonal."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import BLOCK, FREE, ROW, in_order


@njit(parallel=True, fastmath=True, cache=True)
def linearise(values, neighbours, flags, half_inverse, laplace, slopes, flux):
    n = neighbours.shape[0]
    blocks = (n + BLOCK - 1) // BLOCK
    partial = np.zeros(blocks)
    for b in prange(blocks):
        total = 0.0
        for i in range(b * BLOCK, min(n, (b + 1) * BLOCK)):
            if flags[i] & ROW == 0:
                slopes[i] = 0.0
                flux[i] = 0.0
                continue
            a0 = values[neighbours[i, 0]]
            a1 = values[neighbours[i, 1]]
            b0 = values[neighbours[i, 2]]
            b1 = values[neighbours[i, 3]]
            c0 = values[neighbours[i, 4]]
            c1 = values[neighbours[i, 5]]
            v = values[i]
            gx = (a1 - a0) * half_inverse
            gy = (b1 - b0) * half_inverse
            gz = (c1 - c0) * half_inverse
            norm = np.sqrt(gx * gx + gy * gy + gz * gz)
            s = np.float32(1.0) if v > 0 else (np.float32(-1.0) if v < 0 else np.float32(0.0))
            k = s * half_inverse / max(norm, np.float32(1e-6))
            slopes[i, 0] = k * gx
            slopes[i, 1] = k * gy
            slopes[i, 2] = k * gz
            r = (norm - np.float32(1.0)) * s - laplace * (
                a0 + a1 + b0 + b1 + c0 + c1 - np.float32(6.0) * v
            )
            for axis in range(3):
                flux[i, axis] = slopes[i, axis] * r
            flux[i, 3] = r
            total += r * r
        partial[b] = total
    return in_order(partial)


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_rows(v, slopes, neighbours, flags, laplace, flux):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & ROW == 0:
            flux[i] = 0.0
            continue
        a0 = v[neighbours[i, 0]]
        a1 = v[neighbours[i, 1]]
        b0 = v[neighbours[i, 2]]
        b1 = v[neighbours[i, 3]]
        c0 = v[neighbours[i, 4]]
        c1 = v[neighbours[i, 5]]
        r = (
            slopes[i, 0] * (a1 - a0)
            + slopes[i, 1] * (b1 - b0)
            + slopes[i, 2] * (c1 - c0)
            - laplace * (a0 + a1 + b0 + b1 + c0 + c1 - np.float32(6.0) * v[i])
        )
        flux[i, 0] = slopes[i, 0] * r
        flux[i, 1] = slopes[i, 1] * r
        flux[i, 2] = slopes[i, 2] * r
        flux[i, 3] = r


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_columns(flux, neighbours, flags, laplace, scale, out):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & FREE == 0:
            out[i] = 0.0
            continue
        a0 = neighbours[i, 0]
        a1 = neighbours[i, 1]
        b0 = neighbours[i, 2]
        b1 = neighbours[i, 3]
        c0 = neighbours[i, 4]
        c1 = neighbours[i, 5]
        out[i] = scale * (
            flux[a0, 0]
            - flux[a1, 0]
            + flux[b0, 1]
            - flux[b1, 1]
            + flux[c0, 2]
            - flux[c1, 2]
            - laplace
            * (
                flux[a0, 3]
                + flux[a1, 3]
                + flux[b0, 3]
                + flux[b1, 3]
                + flux[c0, 3]
                + flux[c1, 3]
                - np.float32(6.0) * flux[i, 3]
            )
        )


@njit(parallel=True, fastmath=True, cache=True)
def viscosity_diagonal(slopes, neighbours, flags, laplace, scale, out):
    n = neighbours.shape[0]
    for i in prange(n):
        if flags[i] & FREE == 0:
            out[i] = 0.0
            continue
        total = np.float32(36.0) * laplace * laplace if flags[i] & ROW else np.float32(0.0)
        for axis in range(3):
            low = neighbours[i, 2 * axis]
            high = neighbours[i, 2 * axis + 1]
            if flags[low] & ROW:
                total += (slopes[low, axis] - laplace) ** 2
            if flags[high] & ROW:
                total += (slopes[high, axis] + laplace) ** 2
        out[i] = scale * total
