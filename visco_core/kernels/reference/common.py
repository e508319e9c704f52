"""What several plain kernels share. The constants are those of ``visco_core.kernels``."""

from __future__ import annotations

import torch
from torch import Tensor

ROW, FREE = 1, 2


def trilinear(local: Tensor) -> tuple[Tensor, Tensor]:
    """Weights (P, 8) and their gradients (P, 8, 3), in voxels, at ``local`` (P, 3) in [0, 1]."""
    corner = torch.arange(8, device=local.device)
    high = torch.stack([(corner >> 2) & 1, (corner >> 1) & 1, corner & 1], 1).to(local.dtype)
    factors = high * local[:, None] + (1 - high) * (1 - local[:, None])
    signs = 2 * high - 1
    gradients = torch.stack(
        [
            signs[:, 0] * factors[..., 1] * factors[..., 2],
            signs[:, 1] * factors[..., 0] * factors[..., 2],
            signs[:, 2] * factors[..., 0] * factors[..., 1],
        ],
        dim=2,
    )
    return factors.prod(2), gradients
