"""Cubic B-splines between a grid and coarser ones."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def spline_prolong(coarse, side):
    fine = np.empty((side, side, side), np.float32)
    library.spline_prolong(coarse, len(coarse), fine, side)
    return fine


def spline_restrict(fine):
    side = len(fine)
    coarse = np.empty((side // 2 + 1,) * 3, np.float32)
    library.spline_restrict(fine, side, coarse)
    return coarse


def spline_correct(coarse, side, r, z):
    return library.spline_correct(coarse, len(coarse), side, r, z)


def spline_energies(corners, matrices, slabs, ijk, basis, spacing, side):
    out = np.zeros((side, side, side), np.float32)
    points = corners, matrices, slabs, len(slabs) - 1, ijk
    library.spline_energies(*points, basis, (len(basis) - 1) // 2, spacing, side, out)
    return out
