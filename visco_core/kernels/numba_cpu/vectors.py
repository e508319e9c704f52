"""Compiled kernels of vectors over the nodes: conjugate gradients, Adam, sampling."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from visco_core.kernels.numba_cpu.common import BLOCK, in_order


@njit(parallel=True, fastmath=True, cache=True)
def dot(a, b):
    n = a.shape[0]
    blocks = (n + BLOCK - 1) // BLOCK
    partial = np.zeros(blocks)
    for k in prange(blocks):
        # A block is short enough for float32; slices, whose indices cannot be negative, let the
        # loop be vectorised.
        x = a[k * BLOCK : (k + 1) * BLOCK]
        y = b[k * BLOCK : (k + 1) * BLOCK]
        total = np.float32(0)
        for i in range(x.shape[0]):
            total += x[i] * y[i]
        partial[k] = total
    return in_order(partial)


@njit(parallel=True, fastmath=True, cache=True)
def cg_advance(x, r, p, q, alpha):
    for i in prange(x.shape[0]):
        x[i] += alpha * p[i]
        r[i] -= alpha * q[i]


@njit(parallel=True, fastmath=True, cache=True)
def cg_direction(p, z, beta):
    for i in prange(p.shape[0]):
        p[i] = z[i] + beta * p[i]


@njit(parallel=True, fastmath=True, cache=True)
def adam_advance(values, gradient, mean, square, rate, correction, beta1, beta2, tiny):
    for i in prange(values.shape[0]):
        g = gradient[i]
        mean[i] = beta1 * mean[i] + (1 - beta1) * g
        square[i] = beta2 * square[i] + (1 - beta2) * g * g
        values[i] -= rate * mean[i] / (np.sqrt(square[i] / correction) + tiny)


@njit(parallel=True, cache=True)
def _sample(count, limit, seed):
    out = np.empty(count, np.uint8)
    low = np.int64(0xFFFFFFFF)
    start = seed * np.int64(0x9E3779B1) & low
    for i in prange(count):
        h = np.int64(i) ^ start
        h = (h ^ h >> 16) * np.int64(0x85EBCA6B) & low
        h = (h ^ h >> 13) * np.int64(0xC2B2AE35) & low
        out[i] = (h ^ h >> 16) < limit
    return out


def sample(count, fraction, seed):
    return _sample(count, int(fraction * 2**32), seed)
