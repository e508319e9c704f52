"""Plain kernels of the viscosity loss: its rows, their transpose and the diagonal; the operator.

There is a row at every free node, ``runs`` lists them (``free_runs``), and what a kernel writes it
writes there: elsewhere the caller's zeros stay.
"""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import ROW
from visco_core.kernels.reference.points import point_matvec


def _around(runs: Tensor) -> tuple[Tensor, Tensor]:
    """The free nodes (K,) and their neighbours (K, 6) in the order −x, +x, −y, +y, −z, +z."""
    lengths = runs[:, 1] - runs[:, 0]
    first = runs[:, 0] - lengths.cumsum(0) + lengths
    node = torch.repeat_interleave(first, lengths)
    node = node + torch.arange(len(node), device=runs.device)
    sides = node[:, None] + torch.repeat_interleave(runs[:, 2:], lengths, 0)
    return node, torch.cat([sides, node[:, None] - 1, node[:, None] + 1], 1)


def linearise(
    values: Tensor,
    target: Tensor,
    stiffness: Tensor,
    runs: Tensor,
    half_inverse: float,
    laplace: float,
    slopes: Tensor,
    rows: Tensor,
) -> float:
    """Viscosity rows at ``values`` (N + 1,): fills slopes (3, N + 1) and rows with w (r − r₀).

    r = (‖∇̂f‖ − 1)·sign(f) − ε Δ̂f, with half_inverse = 1/2h and laplace = ε/h², r₀ the
    ``target`` (N + 1,) and w the ``stiffness`` (N + 1,); returns Σ w (r − r₀)².
    """
    node, around = _around(runs)
    center, beside = values[node], values[around]
    gradient = (beside[:, 1::2] - beside[:, 0::2]) * half_inverse
    norm = gradient.norm(dim=1)
    sign = torch.sign(center)
    residual = (norm - 1) * sign - laplace * (beside.sum(1) - 6 * center) - target[node]
    slopes[:, node] = (sign * half_inverse / norm.clamp_min(1e-6)) * gradient.T
    rows[node] = stiffness[node] * residual
    return float(residual.double() @ rows[node].double())


def viscosity_columns(
    rows: Tensor, slopes: Tensor, runs: Tensor, laplace: float, scale: float, out: Tensor
) -> None:
    """out = scale · Jᵀ rows."""
    node, around = _around(runs)
    total = -laplace * (rows[around].sum(1) - 6 * rows[node])
    for axis in range(3):
        low, high = around[:, 2 * axis], around[:, 2 * axis + 1]
        total += slopes[axis, low] * rows[low] - slopes[axis, high] * rows[high]
    out[node] = scale * total


def viscosity_diagonal(
    slopes: Tensor,
    stiffness: Tensor,
    runs: Tensor,
    flags: Tensor,
    laplace: float,
    scale: float,
    out: Tensor,
) -> None:
    """out = the diagonal of scale · JᵀWJ."""
    node, around = _around(runs)
    row = (flags & ROW) * stiffness
    total = 36 * laplace**2 * stiffness[node]
    for axis in range(3):
        low, high = around[:, 2 * axis], around[:, 2 * axis + 1]
        total += row[low] * (slopes[axis, low] - laplace) ** 2
        total += row[high] * (slopes[axis, high] + laplace) ** 2
    out[node] = scale * total


def operate(
    v: Tensor,
    slopes: Tensor,
    stiffness: Tensor,
    runs: Tensor,
    run_slabs: Tensor,
    laplace: float,
    scale: float,
    corners: Tensor,
    matrices: Tensor,
    slabs: Tensor,
    flags: Tensor,
    rows: Tensor,
    out: Tensor,
) -> float:
    """out = scale · JᵀWJ v + the points' matrices times v; returns v · out.

    J δ = s n̂·∇̂δ − ε Δ̂δ, W the ``stiffness`` (N + 1,); rows is left with WJ v. ``v`` is zero off the
    free nodes; run_slabs (side + 1,) int64: the first run of each i-slab.
    """
    node, around = _around(runs)
    beside = v[around]
    difference = beside[:, 1::2] - beside[:, 0::2]
    along = (slopes[:, node].T * difference).sum(1)
    rows[node] = stiffness[node] * (along - laplace * (beside.sum(1) - 6 * v[node]))
    viscosity_columns(rows, slopes, runs, laplace, scale, out)
    point_matvec(v, corners, matrices, slabs, flags, out)
    return float(v.double() @ out.double())
