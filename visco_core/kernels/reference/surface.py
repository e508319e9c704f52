"""Plain kernels of marching cubes over the band."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.topology import all_voxels


def _cases(values: Tensor, neighbours: Tensor) -> tuple[Tensor, Tensor]:
    """Corners (N, 8) and marching-cubes case (N,) of each node's voxel, 0 where it is not whole."""
    corners = all_voxels(neighbours)
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
