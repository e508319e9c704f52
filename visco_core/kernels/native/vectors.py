"""Vectors over the nodes: conjugate gradients, Adam, sampling."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def dot(a, b):
    return library.dot(a, b, len(a))


def cg_advance(x, r, p, q, alpha, inverse, z):
    return library.cg_advance(x, r, p, q, alpha, inverse, z, len(x))


def cg_direction(p, z, beta):
    library.cg_direction(p, z, beta, len(p))


def adam_advance(values, gradient, mean, square, rate, correction, beta1, beta2, tiny):
    moments = values, gradient, mean, square, len(values)
    library.adam_advance(*moments, rate, correction, beta1, beta2, tiny)


def sample(count, fraction, seed):
    out = np.empty(count, np.uint8)
    library.sample(count, int(fraction * 2**32), seed, out)
    return out
