"""Plain kernels of what the starting field is made of."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import trilinear


def splat_divergence(points: Tensor, vectors: Tensor, cells: int) -> Tensor:
    """(cells,)³: the divergence of the vectors (P, 3) at the points, as cells would see it.

    Summed against any values of the cells it gives −Σ vector · gradient of their trilinear
    interpolant at the point, in cells. points (P, 3) in [0, 1]³; cell centres lie at
    (i + ½) / cells; what falls outside wraps around.
    """
    scaled = points * cells - 0.5
    base = scaled.floor()
    _, gradients = trilinear(scaled - base)
    sources = -(gradients * vectors[:, None]).sum(2)
    out = sources.new_zeros(cells**3)
    for c in range(8):
        offset = base.new_tensor([c >> 2, c >> 1 & 1, c & 1])
        i, j, k = (base + offset).long().remainder(cells).unbind(1)
        out.index_add_(0, (i * cells + j) * cells + k, sources[:, c])
    return out.reshape(cells, cells, cells)


def squared_distance(region: Tensor) -> Tensor:
    """Squared distance (n,)³, in cells, from each cell of ``region`` to the nearest one outside.

    Separable: along each axis in turn min over j of d²(j) + (i − j)²; 1e20 if nothing is outside.
    """
    squared = torch.where(region, 1e20, 0.0)
    ticks = torch.arange(len(region), device=region.device)
    parabola = (ticks[:, None] - ticks).square()
    for axis in range(3):
        lines = squared.movedim(axis, -1)
        shortest = [(line[..., None, :] + parabola).amin(-1) for line in lines]
        squared = torch.stack(shortest).movedim(-1, axis)
    return squared.clamp_max(1e20).contiguous()
