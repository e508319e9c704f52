"""What several plain kernels share. The constants are those of ``visco_core.kernels``."""

from __future__ import annotations

import torch
from torch import Tensor

ROW, FREE, ENCLOSED = 1, 2, 4


def cyclic_diagonals(matrices: Tensor) -> Tensor:
    """The diagonals (M, 5, 8) of symmetric matrices (M, 8, 8), as the package's docstring says."""
    corner = torch.arange(8, device=matrices.device)
    return matrices[:, corner, (corner + corner[:5, None]) % 8]


def whole_matrices(diagonals: Tensor) -> Tensor:
    """The symmetric matrices (M, 8, 8) of their cyclic diagonals (M, 5, 8)."""
    corner = torch.arange(8, device=diagonals.device)
    ahead = (corner - corner[:, None]) % 8
    row = torch.where(ahead < 5, corner[:, None], corner)
    return diagonals[:, torch.where(ahead < 5, ahead, 8 - ahead), row]


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
