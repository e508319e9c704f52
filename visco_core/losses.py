"""The paper's four losses in plain torch: the specification that every kernel is tested against.

Pumarola, Sanakoyeu, Yariv, Thabet, Lipman, "VisCo Grids", NeurIPS 2022. The unknown is a function
on the nodes of an n × n × n grid over the unit cube, spacing h = 1/(n − 1), trilinear inside a
voxel, negative inside the solid. All functions take ``values`` (n, n, n) and are differentiable.

    L = λp · point_loss + λn · normal_loss + λv · viscosity_loss + λc · coarea_loss

Where this departs from the printed paper:

1. The paper prints the Laplace density with exp(+|s|/β), which grows without bound; it must be
   exp(−|s|/β).
2. The paper does not give β; the default here is 0.01 in units of the cube.
3. The paper prunes nodes with |f| > 0.9, which prunes nothing inside a unit cube, so its units
   differ; here pruning distances are in voxels.
4. sign(f) is held constant when differentiating, as any framework's autograd does.
5. The paper's Table 1 prints a mean d_C of 0.19 for 30 minutes; its own entries average 0.182.
"""

from __future__ import annotations

import torch
from torch import Tensor


def interpolate(values: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Value (P,) and gradient (P, 3) of the trilinear interpolant at points (P, 3) in [0, 1]³."""
    n = values.shape[0]
    scaled = points * (n - 1)
    base = scaled.floor().clamp(0, n - 2).long()
    local = scaled - base
    value = points.new_zeros(len(points))
    gradient = points.new_zeros(len(points), 3)
    for corner in torch.cartesian_prod(*[torch.arange(2, device=points.device)] * 3):
        i, j, k = (base + corner).unbind(1)
        at_corner = values[i, j, k]
        factors = torch.where(corner.bool(), local, 1 - local)
        signs = 2 * corner - 1
        value = value + at_corner * factors.prod(1)
        others = torch.stack([factors[:, [1, 2]], factors[:, [0, 2]], factors[:, [0, 1]]], 1)
        gradient = gradient + at_corner[:, None] * signs * others.prod(2) * (n - 1)
    return value, gradient


def point_loss(values: Tensor, points: Tensor) -> Tensor:
    """1/m Σ f(q)² over the points (m, 3): the surface passes through the scan (equation 4)."""
    return interpolate(values, points)[0].square().mean()


def normal_loss(values: Tensor, points: Tensor, normals: Tensor) -> Tensor:
    """1/m Σ ‖∇f(q) − n‖² with unit outward normals (m, 3) (equation 4)."""
    return (interpolate(values, points)[1] - normals).square().sum(1).mean()


def viscosity_loss(values: Tensor, epsilon: float) -> Tensor:
    """1/n³ Σ [(‖∇̂f‖ − 1)·sign(f) − ε Δ̂f]² over the inner nodes (equation 6).

    ∇̂ are central differences, Δ̂ the 7-point Laplacian. As ε → 0 its minimiser is the viscosity
    solution of the eikonal equation, the signed distance.
    """
    n = values.shape[0]
    h = 1 / (n - 1)
    center = values[1:-1, 1:-1, 1:-1]
    pairs = [
        (values[:-2, 1:-1, 1:-1], values[2:, 1:-1, 1:-1]),
        (values[1:-1, :-2, 1:-1], values[1:-1, 2:, 1:-1]),
        (values[1:-1, 1:-1, :-2], values[1:-1, 1:-1, 2:]),
    ]
    gradient = torch.stack([(high - low) / (2 * h) for low, high in pairs])
    laplacian = (sum(low + high for low, high in pairs) - 6 * center) / h**2
    residual = (gradient.norm(dim=0) - 1) * torch.sign(center) - epsilon * laplacian
    return residual.square().sum() / n**3


def coarea_loss(values: Tensor, beta: float) -> Tensor:
    """1/n³ Σ Φβ(f(w)) ‖∇f(w)‖ over voxel centres w: the surface's area (equation 8).

    Φβ(s) = exp(−|s|/β) / 2β. By the coarea formula the sum tends to the mean area of the level sets
    near zero.
    """
    n = values.shape[0]
    corners = [
        values[a : n - 1 + a, b : n - 1 + b, c : n - 1 + c]
        for a in range(2)
        for b in range(2)
        for c in range(2)
    ]
    stacked = torch.stack(corners)
    mean = stacked.mean(0)
    signs = 2.0 * torch.cartesian_prod(*[torch.arange(2, device=values.device)] * 3) - 1
    weights = signs.to(values.dtype) * (n - 1) / 4
    gradient = torch.einsum("cijk,ca->aijk", stacked, weights)
    density = torch.exp(-mean.abs() / beta) / (2 * beta)
    return (density * gradient.norm(dim=0)).sum() / n**3
