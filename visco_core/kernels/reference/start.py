"""Plain kernels of what the starting field is made of."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import trilinear


def splat(points: Tensor, vectors: Tensor, cells: int) -> Tensor:
    """(C + 1, cells, cells, cells): vectors (P, C) and the count, spread trilinearly.

    points (P, 3) in [0, 1]³; cell centres lie at (i + ½) / cells; what falls outside wraps around.
    """
    scaled = points * cells - 0.5
    base = scaled.floor()
    weights, _ = trilinear(scaled - base)
    spread = torch.cat([vectors, vectors.new_ones(len(vectors), 1)], 1)
    out = spread.new_zeros(spread.shape[1], cells**3)
    for c in range(8):
        offset = base.new_tensor([c >> 2, c >> 1 & 1, c & 1])
        i, j, k = (base + offset).long().remainder(cells).unbind(1)
        out.index_add_(1, (i * cells + j) * cells + k, (spread * weights[:, c, None]).T)
    return out.reshape(-1, cells, cells, cells)


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
