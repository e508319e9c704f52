"""The kernels in plain torch, on CPU and CUDA: what each one computes, said as plainly as possible.

Shapes, shared by every backend: N nodes, M voxels that hold points, P points. A vector over nodes
has N + 1 entries; the last is always zero, and a missing neighbour points to it. A voxel's eight
corners are ordered 4·x + 2·y + z. ``flags`` is ROW where the viscosity loss has a row, FREE where
the value is unknown.

    ijk (N, 3) int16, sorted        grid coordinates of the nodes
    columns (side² + 1,) int64      where each (i, j) column of nodes starts
    neighbours (N, 6) int32         −x, +x, −y, +y, −z, +z; N where there is none
    flags (N + 1,) uint8            bits ROW and FREE
    slopes (N + 1, 3) float32       s·n̂ / 2h of the linearised viscosity row
    flux (N + 1, 4) float32         slopes times the row's value, and the row's value
    corners (M, 8) int32            nodes of the voxels that hold points
    matrices (M, 8, 8) float32      normal matrix of a voxel's points
    slabs (side + 1,) int64         where each i-slab of voxels starts in ``corners``
"""

from __future__ import annotations

import torch
from torch import Tensor

ROW, FREE = 1, 2


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


def _trilinear(local: Tensor) -> tuple[Tensor, Tensor]:
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
    """Normal matrices (M, 8, 8) and right-hand sides (M, 8) of the point and normal losses.

    local (P, 3): position in the voxel, sorted by voxel; normals (P, 3); starts (M + 1,).
    M = point_weight Σ w wᵀ + normal_weight Σ G Gᵀ, b = normal_weight Σ G n.
    """
    weights, gradients = _trilinear(local)
    gradients = gradients * resolution
    matrix = point_weight * weights[:, :, None] * weights[:, None, :]
    matrix += normal_weight * gradients @ gradients.transpose(1, 2)
    vector = normal_weight * (gradients @ normals[:, :, None])[..., 0]
    voxel = _voxel_of_point(starts)
    voxels = len(starts) - 1
    return (
        matrix.new_zeros(voxels, 8, 8).index_add_(0, voxel, matrix),
        vector.new_zeros(voxels, 8).index_add_(0, voxel, vector),
    )


def point_sums(
    values: Tensor, corners: Tensor, local: Tensor, normals: Tensor, starts: Tensor, resolution: int
) -> tuple[float, float]:
    """Σ f(q)² and Σ ‖∇f(q) − n‖² over the points."""
    weights, gradients = _trilinear(local)
    at_corners = values[corners.long()][_voxel_of_point(starts)]
    value = (weights * at_corners).sum(1)
    gradient = (gradients * at_corners[..., None]).sum(1) * resolution
    mismatch = (gradient - normals).square().sum(1)
    return float(value.double().square().sum()), float(mismatch.double().sum())


def point_matvec(
    v: Tensor, corners: Tensor, matrices: Tensor, slabs: Tensor, flags: Tensor, out: Tensor
) -> None:
    """out += Σ over voxels of M v at the corners that are free."""
    scatter((matrices @ v[corners.long()][..., None])[..., 0], corners, slabs, flags, out)


def scatter(per_corner: Tensor, corners: Tensor, slabs: Tensor, flags: Tensor, out: Tensor) -> None:
    """out[corners] += per_corner (M, 8) at the corners that are free."""
    free = (flags & FREE).bool()[corners.long()]
    out.index_add_(0, corners.long().flatten(), (per_corner * free).flatten())


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
    corners = _all_voxels(neighbours)
    whole = (corners < len(neighbours)).all(1) & (flags[:-1] & ROW).bool()
    corners = corners[whole]
    at_corners = values[corners]
    _, gradients = _trilinear(values.new_full((1, 3), 0.5))
    mean = at_corners.mean(1)
    gradient = (at_corners @ gradients[0]) * resolution
    norm = gradient.norm(dim=1)
    density = torch.exp(-mean.abs() / beta) / (2 * beta)
    along = (gradient / norm.clamp_min(1e-6)[:, None]) @ gradients[0].T * resolution
    slope = -torch.sign(mean) / beta * norm / 8
    per_corner = scale * density[:, None] * (along + slope[:, None])
    scatter(per_corner, corners, slabs, flags, out)
    return float((density * norm).double().sum())


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


def spline_energies(
    corners: Tensor, matrices: Tensor, ijk: Tensor, basis: Tensor, spacing: int, side: int
) -> Tensor:
    """Σ over voxels of φᵀ M φ for the spline φ of every knot: (side,)³.

    basis (2·reach + 1,): the spline at the nodes around its knot; knots lie ``spacing`` apart.
    """
    reach = (len(basis) - 1) // 2
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
        energy = torch.einsum("mr,mrc,mc->m", weights, matrices, weights)
        inside = ((knot >= 0) & (knot < side)).all(1)
        i, j, k = knot[inside].unbind(1)
        out.index_add_(0, (i * side + j) * side + k, energy[inside])
    return out.reshape(side, side, side)


def dot(a: Tensor, b: Tensor) -> float:
    """Σ a b, in float64."""
    return float(a.double() @ b.double())


def cg_advance(x: Tensor, r: Tensor, p: Tensor, q: Tensor, alpha: float) -> None:
    """x += αp, r −= αq."""
    x += alpha * p
    r -= alpha * q


def cg_direction(p: Tensor, z: Tensor, beta: float) -> None:
    """p = z + βp."""
    p *= beta
    p += z


def splat(points: Tensor, vectors: Tensor, cells: int) -> Tensor:
    """(C + 1, cells, cells, cells): vectors (P, C) and the count, spread trilinearly.

    points (P, 3) in [0, 1]³; cell centres lie at (i + ½) / cells; what falls outside wraps around.
    """
    scaled = points * cells - 0.5
    base = scaled.floor()
    weights, _ = _trilinear(scaled - base)
    spread = torch.cat([vectors, vectors.new_ones(len(vectors), 1)], 1)
    out = spread.new_zeros(spread.shape[1], cells**3)
    for c in range(8):
        offset = base.new_tensor([c >> 2, c >> 1 & 1, c & 1])
        i, j, k = (base + offset).long().remainder(cells).unbind(1)
        out.index_add_(1, (i * cells + j) * cells + k, (spread * weights[:, c, None]).T)
    return out.reshape(-1, cells, cells, cells)


def sample(count: int, fraction: float, seed: int) -> Tensor:
    """(count,) uint8: 1 with probability ``fraction``, by MurmurHash3 of index and seed."""
    low = 0xFFFFFFFF
    h = torch.arange(count) ^ (seed * 0x9E3779B1 & low)
    h = (h ^ h >> 16) * 0x85EBCA6B & low
    h = (h ^ h >> 13) * 0xC2B2AE35 & low
    return ((h ^ h >> 16) < int(fraction * 2**32)).to(torch.uint8)


def adam_advance(
    values: Tensor,
    gradient: Tensor,
    mean: Tensor,
    square: Tensor,
    rate: float,
    correction: float,
    beta1: float,
    beta2: float,
    tiny: float,
) -> None:
    """One Adam update in place: rate = lr / (1 − β₁ᵗ), correction = 1 − β₂ᵗ."""
    mean.mul_(beta1).add_(gradient, alpha=1 - beta1)
    square.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
    values -= rate * mean / ((square / correction).sqrt() + tiny)


def _keys(ijk: Tensor, side: int) -> Tensor:
    i, j, k = ijk.long().unbind(1)
    return (i * side + j) * side + k


def find_nodes(query: Tensor, ijk: Tensor, columns: Tensor, side: int) -> Tensor:
    """Index (Q,) int32 of each queried (i, j, k), N where there is no such node."""
    keys = _keys(ijk, side)
    wanted = _keys(query, side)
    found = torch.searchsorted(keys, wanted).clamp_max(len(keys) - 1)
    return torch.where(keys[found] == wanted, found, len(keys)).int()


def neighbour_table(ijk: Tensor, columns: Tensor, side: int) -> tuple[Tensor, Tensor]:
    """The six neighbours (N, 6) int32 of every node, and its flags: ROW and FREE if it has all."""
    table = []
    for axis in range(3):
        for step in (-1, 1):
            query = ijk.clone()
            query[:, axis] += step
            outside = (query[:, axis] < 0) | (query[:, axis] >= side)
            found = find_nodes(query.clamp(0, side - 1), ijk, columns, side)
            table.append(torch.where(outside, len(ijk), found))
    neighbours = torch.stack(table, 1).int()
    flags = neighbours.new_zeros(len(ijk) + 1, dtype=torch.uint8)
    flags[:-1] = (neighbours < len(ijk)).all(1) * (ROW | FREE)
    return neighbours, flags


def refine(
    ijk: Tensor, columns: Tensor, values: Tensor, side: int, limit: float
) -> tuple[Tensor, Tensor, Tensor]:
    """The nodes of the next level, 2·side − 1 an axis: their ijk, columns and values (N' + 1,).

    A node is kept when all its parents exist (1, 2, 4 or 8, whose mean is its value) and either
    |value| < limit or the parents differ in sign.
    """
    fine_side = 2 * side - 1
    children = torch.cartesian_prod(*[torch.arange(2, device=ijk.device)] * 3)
    fine = (2 * ijk.long()[:, None] + children).reshape(-1, 3)
    fine = fine[(fine < fine_side).all(1)]
    fine = fine[torch.argsort(_keys(fine, fine_side))]
    parents = []
    for corner in children:
        parent = torch.where(corner.bool(), (fine + 1) // 2, fine // 2)
        parents.append(find_nodes(parent, ijk, columns, side))
    index = torch.stack(parents, 1).long()
    at_parents = values[index]
    mean = at_parents.mean(1)
    signs = (at_parents < 0).sum(1)
    keep = (index < len(ijk)).all(1)
    keep &= (mean.abs() < limit) | ((signs > 0) & (signs < 8))
    fine, mean = fine[keep], mean[keep]
    column = fine[:, 0] * fine_side + fine[:, 1]
    count = torch.bincount(column, minlength=fine_side**2)
    starts = torch.cat([count.new_zeros(1), count.cumsum(0)])
    return fine.to(torch.int16), starts, torch.cat([mean, mean.new_zeros(1)])


def voxel_corners(neighbours: Tensor, base: Tensor) -> Tensor:
    """The eight nodes (M, 8) int32 of the voxels above nodes ``base`` (M,).

    All eight are N where one is missing.
    """
    table = torch.cat([neighbours, neighbours.new_full((1, 6), len(neighbours))])
    corners = [base.int()]
    for corner in range(1, 8):
        if corner & 1:
            corners.append(table[corners[corner - 1], 5])
        elif corner & 2:
            corners.append(table[corners[corner - 2], 3])
        else:
            corners.append(table[corners[corner - 4], 1])
    stacked = torch.stack(corners, 1)
    whole = (stacked < len(neighbours)).all(1)
    return torch.where(whole[:, None], stacked, len(neighbours))


def _all_voxels(neighbours: Tensor) -> Tensor:
    return voxel_corners(neighbours, torch.arange(len(neighbours), device=neighbours.device)).long()


def _cases(values: Tensor, neighbours: Tensor) -> tuple[Tensor, Tensor]:
    """Corners (N, 8) and marching-cubes case (N,) of each node's voxel, 0 where it is not whole."""
    corners = _all_voxels(neighbours)
    whole = (corners < len(neighbours)).all(1)
    bits = 1 << torch.arange(8, device=values.device)
    return corners, ((values[corners] < 0) * bits).sum(1) * whole


def _cut(values: Tensor, neighbours: Tensor) -> Tensor:
    """(N, 3) bool: whether the edge from each node to its +x, +y, +z neighbour crosses zero."""
    high = neighbours[:, 1::2].long()
    return (high < len(neighbours)) & ((values[high] < 0) != (values[:-1, None] < 0))


def surface_counts(
    values: Tensor, neighbours: Tensor, counts_of_case: Tensor
) -> tuple[Tensor, Tensor]:
    """Cut edges that each node owns and triangles in the voxel above it, both (N,) uint8."""
    _, case = _cases(values, neighbours)
    return _cut(values, neighbours).sum(1).to(torch.uint8), counts_of_case[case]


def surface_vertices(
    values: Tensor, ijk: Tensor, neighbours: Tensor, first_vertex: Tensor
) -> tuple[Tensor, Tensor]:
    """Vertices (V, 3) in voxels where the edges cross zero, and the unit gradient (V, 3) there.

    first_vertex (N + 1,) int64: where the cut edges of each node start.
    """
    node, axis = torch.nonzero(_cut(values, neighbours), as_tuple=True)
    other = neighbours[node, 2 * axis + 1].long()
    t = (values[node] / (values[node] - values[other])).clamp(1e-4, 1 - 1e-4)
    vertices = ijk[node].to(values.dtype)
    vertices[torch.arange(len(node), device=node.device), axis] += t
    own = torch.arange(len(ijk), device=node.device)[:, None]
    low, high = neighbours[:, 0::2].long(), neighbours[:, 1::2].long()
    low, high = torch.where(low == len(ijk), own, low), torch.where(high == len(ijk), own, high)
    span = ((low != own).int() + (high != own).int()).clamp_min(1)
    gradient = (values[high] - values[low]) / span
    normal = (1 - t)[:, None] * gradient[node] + t[:, None] * gradient[other]
    return vertices, normal / normal.norm(dim=1, keepdim=True).clamp_min(1e-20)


def surface_faces(
    values: Tensor,
    neighbours: Tensor,
    first_vertex: Tensor,
    first_triangle: Tensor,
    edges_of_case: Tensor,
    edge_owner: Tensor,
    edge_axis: Tensor,
) -> Tensor:
    """The triangles (F, 3) int32 of every voxel as vertex indices, counter-clockwise outside."""
    corners, case = _cases(values, neighbours)
    counts = torch.diff(first_triangle)
    repeated = torch.repeat_interleave(torch.arange(len(counts), device=values.device), counts)
    slot = torch.arange(len(repeated), device=values.device) - first_triangle[repeated]
    edges = edges_of_case[case[repeated], slot].long()
    owner = corners[repeated[:, None], edge_owner[edges].long()]
    cut = _cut(values, neighbours).int()
    before = torch.cumsum(cut, 1) - cut
    return (first_vertex[owner] + before[owner, edge_axis[edges].long()]).int()
