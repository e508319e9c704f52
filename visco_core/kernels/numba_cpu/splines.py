"""Compiled kernels of cubic B-splines between a grid and coarser ones.

A plane of the result is made at a time, axis after axis, in buffers that stay in the cache. Their
borders are zero, so that no line needs a case for its ends.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(inline="always")
def _taps(j):
    """The first of three coefficients that make fine entry ``j``, and their weights."""
    if j % 2:
        return j // 2, (np.float32(0.5), np.float32(0.5), np.float32(0))
    return j // 2 - 1, (np.float32(0.125), np.float32(0.75), np.float32(0.125))


@njit(inline="always")
def _add(out, weight, line):
    """out (B,) += weight · line (B,)."""
    for t in range(out.shape[0]):
        out[t] += weight * line[t]


@njit(parallel=True, fastmath=True, cache=True)
def spline_prolong(coarse, side):
    n = coarse.shape[0]
    fine = np.empty((side, side, side), np.float32)
    for i in prange(side):
        plane = np.zeros((n + 3, n + 3), np.float32)
        line = np.empty(n + 3, np.float32)
        first, weights = _taps(i)
        for tap in range(3):
            h = first + tap
            if 0 <= h < n:
                for b in range(n):
                    _add(plane[b + 1, 1 : n + 1], weights[tap], coarse[h, b])
        for j in range(side):
            first, weights = _taps(j)
            line[:] = 0
            for tap in range(3):
                _add(line, weights[tap], plane[first + 1 + tap])
            low, middle, high = line[:n], line[1 : n + 1], line[2 : n + 2]
            even, odd = fine[i, j, ::2], fine[i, j, 1::2]
            for h in range(even.shape[0]):
                around = low[h] + high[h]
                even[h] = np.float32(0.75) * middle[h] + np.float32(0.125) * around
            for h in range(odd.shape[0]):
                odd[h] = np.float32(0.5) * (middle[h] + high[h])
    return fine


@njit(parallel=True, fastmath=True, cache=True)
def spline_restrict(fine):
    side = fine.shape[0]
    n = side // 2 + 1
    coarse = np.empty((n, n, n), np.float32)
    weights = np.array([0.125, 0.5, 0.75, 0.5, 0.125], np.float32)
    for h in prange(n):
        plane = np.zeros((side + 5, side + 5), np.float32)
        line = np.empty(side + 5, np.float32)
        for tap in range(5):
            i = 2 * h + tap - 2
            if 0 <= i < side:
                for j in range(side):
                    _add(plane[j + 2, 2 : side + 2], weights[tap], fine[i, j])
        for b in range(n):
            line[:] = 0
            for tap in range(5):
                _add(line, weights[tap], plane[2 * b + tap])
            out = coarse[h, b]
            for d in range(n):
                outer, inner = line[2 * d] + line[2 * d + 4], line[2 * d + 1] + line[2 * d + 3]
                out[d] = (
                    np.float32(0.125) * outer
                    + np.float32(0.5) * inner
                    + np.float32(0.75) * line[2 * d + 2]
                )
    return coarse


@njit(parallel=True, fastmath=True, cache=True)
def spline_energies(corners, matrices, slabs, ijk, basis, spacing, side):
    reach = (basis.shape[0] - 1) // 2
    out = np.zeros((side, side, side), np.float32)
    last = slabs.shape[0] - 2
    for a in prange(side):
        low = np.empty(3, np.int64)
        high = np.empty(3, np.int64)
        w = np.empty(8, np.float32)
        begin = slabs[min(max(a * spacing - reach - 1, 0), last + 1)]
        end = slabs[min(a * spacing + reach, last) + 1]
        for m in range(begin, end):
            node = ijk[corners[m, 0]]
            for axis in range(1, 3):
                low[axis] = max((node[axis] - reach + spacing - 1) // spacing, 0)
                high[axis] = min((node[axis] + 1 + reach) // spacing, side - 1)
            for b in range(low[1], high[1] + 1):
                for d in range(low[2], high[2] + 1):
                    for c in range(8):
                        x = node[0] + (c >> 2) - a * spacing + reach
                        y = node[1] + (c >> 1 & 1) - b * spacing + reach
                        z = node[2] + (c & 1) - d * spacing + reach
                        inside = min(x, y, z) >= 0 and max(x, y, z) <= 2 * reach
                        w[c] = basis[x] * basis[y] * basis[z] if inside else np.float32(0)
                    total = np.float32(0)
                    for r in range(8):
                        for c in range(8):
                            total += w[r] * matrices[m, r, c] * w[c]
                    out[a, b, d] += total
    return out
