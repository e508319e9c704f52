"""Plain kernels of the coarea loss."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import ROW, trilinear
from visco_core.kernels.reference.points import scatter
from visco_core.kernels.reference.topology import all_voxels


def coarea(
    values: Tensor,
    neighbours: Tensor,
    slabs: Tensor,
    flags: Tensor,
    resolution: int,
    beta: float,
    scale: float,
    out: Tensor,
) -> float:
    """Adds scale · ∂Σ Φβ(f) ‖∇f‖ over voxel centres to ``out``; returns the sum.

    Only voxels whose lowest node carries a row are summed; ``slabs`` are those of the nodes.
    """
    corners = all_voxels(neighbours)
    whole = (corners < len(neighbours)).all(1) & (flags[:-1] & ROW).bool()
    corners = corners[whole]
    at_corners = values[corners]
    _, gradients = trilinear(values.new_full((1, 3), 0.5))
    mean = at_corners.mean(1)
    gradient = (at_corners @ gradients[0]) * resolution
    norm = gradient.norm(dim=1)
    density = torch.exp(-mean.abs() / beta) / (2 * beta)
    along = (gradient / norm.clamp_min(1e-6)[:, None]) @ gradients[0].T * resolution
    slope = -torch.sign(mean) / beta * norm / 8
    per_corner = scale * density[:, None] * (along + slope[:, None])
    scatter(per_corner, corners, slabs, flags, out)
    return float((density * norm).double().sum())
