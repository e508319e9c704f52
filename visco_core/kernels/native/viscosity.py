"""The viscosity loss's rows, their transpose and the diagonal; and the whole operator."""

from __future__ import annotations

from visco_core.kernels.native import library


def linearise(values, target, stiffness, runs, half_inverse, laplace, slopes, rows):
    out = slopes, slopes.shape[1], rows
    return library.linearise(
        values, target, stiffness, runs, len(runs), half_inverse, laplace, *out
    )


def viscosity_columns(rows, slopes, runs, laplace, scale, out):
    library.viscosity_columns(rows, slopes, slopes.shape[1], runs, len(runs), laplace, scale, out)


def viscosity_diagonal(slopes, stiffness, runs, flags, laplace, scale, out):
    rows = slopes, slopes.shape[1], stiffness, runs, len(runs)
    library.viscosity_diagonal(*rows, flags, laplace, scale, out)


def operate(
    v,
    slopes,
    stiffness,
    runs,
    run_slabs,
    laplace,
    scale,
    corners,
    matrices,
    slabs,
    flags,
    rows,
    out,
):
    system = v, slopes, slopes.shape[1], stiffness, runs, run_slabs, len(run_slabs) - 1
    return library.operate(*system, laplace, scale, corners, matrices, slabs, flags, rows, out)
