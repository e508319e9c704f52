"""Compiled kernels of the coarea loss."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import FREE, ROW, corners_above, in_order, trilinear


@njit(parallel=True, fastmath=True, cache=True)
def coarea(values, neighbours, slabs, flags, resolution, beta, scale, out):
    count = slabs.shape[0] - 1
    partial = np.zeros(count)
    for parity in range(2):
        for half in prange((count + 1 - parity) // 2):
            slab = 2 * half + parity
            corners = np.empty(8, np.int32)
            w = np.empty(8, np.float32)
            g = np.empty((8, 3), np.float32)
            trilinear(np.float32(0.5), np.float32(0.5), np.float32(0.5), w, g)
            total = 0.0
            for i in range(slabs[slab], slabs[slab + 1]):
                if flags[i] & ROW == 0 or not corners_above(i, neighbours, corners):
                    continue
                mean = np.float32(0.0)
                gx = np.float32(0.0)
                gy = np.float32(0.0)
                gz = np.float32(0.0)
                for c in range(8):
                    f = values[corners[c]]
                    mean += w[c] * f
                    gx += g[c, 0] * f * resolution
                    gy += g[c, 1] * f * resolution
                    gz += g[c, 2] * f * resolution
                norm = np.sqrt(gx * gx + gy * gy + gz * gz)
                density = np.exp(-abs(mean) / beta) / (2 * beta)
                total += density * norm
                along = resolution / max(norm, np.float32(1e-6))
                slope = -np.sign(mean) / beta * norm / 8
                for c in range(8):
                    if flags[corners[c]] & FREE:
                        directed = gx * g[c, 0] + gy * g[c, 1] + gz * g[c, 2]
                        out[corners[c]] += scale * density * (along * directed + slope)
            partial[slab] = total
    return in_order(partial)
