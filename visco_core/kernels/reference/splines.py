"""Plain kernels of cubic B-splines between a grid and coarser ones."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import whole_matrices


def spline_prolong(coarse: Tensor, side: int) -> Tensor:
    """Values (side,)³ of the cubic B-splines with coefficients ``coarse`` (side // 2 + 1,)³.

    Knots lie on every second node; refinement by [1 4 6 4 1] / 8 along each axis.
    """
    for axis in range(3):
        c = coarse.movedim(axis, 0)
        edge = torch.zeros_like(c[:1])
        low, high = torch.cat([edge, c[:-1]]), torch.cat([c[1:], edge])
        pairs = torch.stack([0.75 * c + 0.125 * (low + high), 0.5 * (c + high)], 1)
        coarse = pairs.flatten(0, 1)[:side].movedim(0, axis)
    return coarse.contiguous()


def spline_restrict(fine: Tensor) -> Tensor:
    """The transpose of ``spline_prolong``: (n,)³ to (n // 2 + 1,)³."""
    side = len(fine) // 2 + 1
    for axis in range(3):
        f = fine.movedim(axis, 0)
        padded = f.new_zeros(2 * side + 3, *f.shape[1:])
        padded[2 : 2 + len(f)] = f
        taps = [padded[k : k + 2 * side : 2] for k in range(5)]
        total = 0.125 * (taps[0] + taps[4]) + 0.5 * (taps[1] + taps[3]) + 0.75 * taps[2]
        fine = total.movedim(0, axis)
    return fine.contiguous()


def spline_correct(coarse: Tensor, side: int, r: Tensor, z: Tensor) -> float:
    """z += the splines' values at the inner nodes of the dense grid; returns Σ r z.

    r, z (side³ + 1,): vectors over the nodes.
    """
    inner = (slice(1, side - 1),) * 3
    z[:-1].view(side, side, side)[inner] += spline_prolong(coarse, side)[inner]
    return float(r.double() @ z.double())


def spline_energies(
    corners: Tensor,
    matrices: Tensor,
    slabs: Tensor,
    ijk: Tensor,
    basis: Tensor,
    spacing: int,
    side: int,
) -> Tensor:
    """Σ over voxels of φᵀ A φ for the spline φ of every knot: (side,)³.

    basis (2·reach + 1,): the spline at the nodes around its knot; knots lie ``spacing`` apart.
    """
    reach = (len(basis) - 1) // 2
    whole = whole_matrices(matrices)
    node = ijk[corners[:, 0].long()].long()
    first = torch.div(node - reach + spacing - 1, spacing, rounding_mode="floor")
    padded = torch.cat([basis, basis.new_zeros(1)])
    corner = torch.cartesian_prod(*[torch.arange(2, device=node.device)] * 3)
    out = basis.new_zeros(side**3)
    knots_around = torch.arange((2 * reach + 1) // spacing + 1, device=node.device)
    for step in torch.cartesian_prod(*[knots_around] * 3):
        knot = first + step
        offset = node[:, None] + corner - spacing * knot[:, None] + reach
        offset = torch.where((offset < 0) | (offset > 2 * reach), 2 * reach + 1, offset)
        weights = padded[offset].prod(2)
        energy = torch.einsum("mr,mrc,mc->m", weights, whole, weights)
        inside = ((knot >= 0) & (knot < side)).all(1)
        i, j, k = knot[inside].unbind(1)
        out.index_add_(0, (i * side + j) * side + k, energy[inside])
    return out.reshape(side, side, side)
