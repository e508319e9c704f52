"""Compiled kernels of cubic B-splines between a grid and coarser ones."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import along_axes


@njit(parallel=True, fastmath=True, cache=True)
def _spline_up(coarse, fine):
    """Along the middle axis: (A, n', B) to (A, n, B)."""
    last = coarse.shape[1] - 1
    for a in prange(coarse.shape[0]):
        for j in range(fine.shape[1]):
            h = j // 2
            for t in range(coarse.shape[2]):
                high = coarse[a, h + 1, t] if h < last else np.float32(0)
                if j % 2:
                    fine[a, j, t] = np.float32(0.5) * (coarse[a, h, t] + high)
                else:
                    low = coarse[a, h - 1, t] if h > 0 else np.float32(0)
                    fine[a, j, t] = np.float32(0.75) * coarse[a, h, t] + np.float32(0.125) * (
                        low + high
                    )


@njit(parallel=True, fastmath=True, cache=True)
def _spline_down(fine, coarse):
    """Along the middle axis: (A, n, B) to (A, n', B), the transpose of ``_spline_up``."""
    side = fine.shape[1]
    for a in prange(fine.shape[0]):
        for h in range(coarse.shape[1]):
            for t in range(fine.shape[2]):
                total = np.float32(0)
                for offset in range(-2, 3):
                    j = 2 * h + offset
                    if 0 <= j < side:
                        w = (0.75, 0.5, 0.125)[abs(offset)]
                        total += np.float32(w) * fine[a, j, t]
                coarse[a, h, t] = total


def spline_prolong(coarse, side):
    return along_axes(_spline_up, coarse, side)


def spline_restrict(fine):
    return along_axes(_spline_down, fine, len(fine) // 2 + 1)


@njit(fastmath=True, cache=True)
def spline_energies(corners, matrices, ijk, basis, spacing, side):
    reach = (basis.shape[0] - 1) // 2
    out = np.zeros((side, side, side), np.float32)
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    w = np.empty(8, np.float32)
    for m in range(corners.shape[0]):
        node = ijk[corners[m, 0]]
        for axis in range(3):
            low[axis] = max((node[axis] - reach + spacing - 1) // spacing, 0)
            high[axis] = min((node[axis] + 1 + reach) // spacing, side - 1)
        for a in range(low[0], high[0] + 1):
            for b in range(low[1], high[1] + 1):
                for d in range(low[2], high[2] + 1):
                    for c in range(8):
                        x = node[0] + (c >> 2) - a * spacing + reach
                        y = node[1] + (c >> 1 & 1) - b * spacing + reach
                        z = node[2] + (c & 1) - d * spacing + reach
                        inside = min(x, y, z) >= 0 and max(x, y, z) <= 2 * reach
                        w[c] = basis[x] * basis[y] * basis[z] if inside else np.float32(0)
                    for r in range(8):
                        for c in range(8):
                            out[a, b, d] += w[r] * matrices[m, r, c] * w[c]
    return out
