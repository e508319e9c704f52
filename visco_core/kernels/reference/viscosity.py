"""Plain kernels of the viscosity loss: its rows, their transpose and the diagonal."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import FREE, ROW


def linearise(
    values: Tensor,
    neighbours: Tensor,
    flags: Tensor,
    half_inverse: float,
    laplace: float,
    slopes: Tensor,
    flux: Tensor,
) -> float:
    """Viscosity rows at ``values`` (N + 1,): fills slopes and flux, returns Σ r².

    r = (‖∇̂f‖ − 1)·sign(f) − ε Δ̂f, with half_inverse = 1/2h and laplace = ε/h².
    """
    around = values[neighbours.long()]
    center = values[:-1]
    row = (flags[:-1] & ROW).bool()
    gradient = (around[:, 1::2] - around[:, 0::2]) * half_inverse
    norm = gradient.norm(dim=1)
    sign = torch.sign(center)
    residual = (norm - 1) * sign - laplace * (around.sum(1) - 6 * center)
    residual = torch.where(row, residual, torch.zeros_like(residual))
    direction = (sign * half_inverse / norm.clamp_min(1e-6))[:, None] * gradient
    slopes[:-1] = torch.where(row[:, None], direction, torch.zeros_like(direction))
    flux[:-1, :3] = slopes[:-1] * residual[:, None]
    flux[:-1, 3] = residual
    return float(residual.double().square().sum())


def viscosity_rows(
    v: Tensor, slopes: Tensor, neighbours: Tensor, flags: Tensor, laplace: float, flux: Tensor
) -> None:
    """flux = (slopes · r, r) with r = J v, J δ = s n̂·∇̂δ − ε Δ̂δ, at every row."""
    around = v[neighbours.long()]
    difference = around[:, 1::2] - around[:, 0::2]
    rows = (slopes[:-1] * difference).sum(1) - laplace * (around.sum(1) - 6 * v[:-1])
    rows = rows * (flags[:-1] & ROW)
    flux[:-1, :3] = slopes[:-1] * rows[:, None]
    flux[:-1, 3] = rows


def viscosity_columns(
    flux: Tensor, neighbours: Tensor, flags: Tensor, laplace: float, scale: float, out: Tensor
) -> None:
    """out = scale · Jᵀ r at every free node, zero elsewhere."""
    around = neighbours.long()
    total = -laplace * (flux[around, 3].sum(1) - 6 * flux[:-1, 3])
    for axis in range(3):
        total += flux[around[:, 2 * axis], axis] - flux[around[:, 2 * axis + 1], axis]
    out[:-1] = scale * total * (flags[:-1] & FREE).bool()


def viscosity_diagonal(
    slopes: Tensor, neighbours: Tensor, flags: Tensor, laplace: float, scale: float, out: Tensor
) -> None:
    """out = the diagonal of scale · JᵀJ at every free node, zero elsewhere."""
    row = (flags & ROW).to(slopes.dtype)
    total = 36 * laplace**2 * row[:-1]
    for axis in range(3):
        low, high = neighbours[:, 2 * axis].long(), neighbours[:, 2 * axis + 1].long()
        total = total + row[low] * (slopes[low, axis] - laplace) ** 2
        total = total + row[high] * (slopes[high, axis] + laplace) ** 2
    out[:-1] = scale * total * (flags[:-1] & FREE).bool()
