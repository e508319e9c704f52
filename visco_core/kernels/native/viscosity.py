"""The viscosity loss's rows, their transpose and the diagonal; and the whole operator."""

from __future__ import annotations

from visco_core.kernels.native import library


def linearise(values, target, runs, half_inverse, laplace, slopes, rows):
    out = slopes, slopes.shape[1], rows
    return library.linearise(values, target, runs, len(runs), half_inverse, laplace, *out)


def viscosity_columns(rows, slopes, runs, laplace, scale, out):
    library.viscosity_columns(rows, slopes, slopes.shape[1], runs, len(runs), laplace, scale, out)


def viscosity_diagonal(slopes, runs, flags, laplace, scale, out):
    library.viscosity_diagonal(slopes, slopes.shape[1], runs, len(runs), flags, laplace, scale, out)


def operate(v, slopes, runs, run_slabs, laplace, scale, corners, matrices, slabs, flags, rows, out):
    system = v, slopes, slopes.shape[1], runs, run_slabs, len(run_slabs) - 1, laplace, scale
    return library.operate(*system, corners, matrices, slabs, flags, rows, out)
