"""Plain kernels of the point and normal losses, gathered per voxel."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import FREE, cyclic_diagonals, trilinear, whole_matrices


def _voxel_of_point(starts: Tensor) -> Tensor:
    counts = starts[1:] - starts[:-1]
    return torch.repeat_interleave(torch.arange(len(counts), device=starts.device), counts)


def point_system(
    local: Tensor,
    normals: Tensor,
    starts: Tensor,
    resolution: int,
    point_weight: float,
    normal_weight: float,
) -> tuple[Tensor, Tensor]:
    """Normal matrices (M, 5, 8) and right-hand sides (M, 8) of the point and normal losses.

    local (P, 3): position in the voxel, sorted by voxel; normals (P, 3); starts (M + 1,).
    A = point_weight Σ w wᵀ + normal_weight Σ G Gᵀ, b = normal_weight Σ G n.
    """
    weights, gradients = trilinear(local)
    gradients = gradients * resolution
    matrix = point_weight * weights[:, :, None] * weights[:, None, :]
    matrix += normal_weight * gradients @ gradients.transpose(1, 2)
    vector = normal_weight * (gradients @ normals[:, :, None])[..., 0]
    voxel = _voxel_of_point(starts)
    voxels = len(starts) - 1
    return (
        cyclic_diagonals(matrix.new_zeros(voxels, 8, 8).index_add_(0, voxel, matrix)),
        vector.new_zeros(voxels, 8).index_add_(0, voxel, vector),
    )


def point_sums(
    values: Tensor, corners: Tensor, local: Tensor, normals: Tensor, starts: Tensor, resolution: int
) -> tuple[float, float]:
    """Σ f(q)² and Σ ‖∇f(q) − n‖² over the points."""
    weights, gradients = trilinear(local)
    at_corners = values[corners.long()][_voxel_of_point(starts)]
    value = (weights * at_corners).sum(1)
    gradient = (gradients * at_corners[..., None]).sum(1) * resolution
    mismatch = (gradient - normals).square().sum(1)
    return float(value.double().square().sum()), float(mismatch.double().sum())


def point_matvec(
    v: Tensor, corners: Tensor, matrices: Tensor, slabs: Tensor, flags: Tensor, out: Tensor
) -> None:
    """out += Σ over voxels of A v at the corners that are free."""
    at_corners = v[corners.long()][..., None]
    scatter((whole_matrices(matrices) @ at_corners)[..., 0], corners, slabs, flags, out)


def scatter(per_corner: Tensor, corners: Tensor, slabs: Tensor, flags: Tensor, out: Tensor) -> None:
    """out[corners] += per_corner (M, 8) at the corners that are free."""
    free = (flags & FREE).bool()[corners.long()]
    out.index_add_(0, corners.long().flatten(), (per_corner * free).flatten())
