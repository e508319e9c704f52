"""Plain kernels of which nodes exist and who is beside whom."""

from __future__ import annotations

import torch
from torch import Tensor

from visco_core.kernels.reference.common import ENCLOSED, FREE, ROW


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
    """The six neighbours (N, 6) int32 of every node, and its flags.

    ROW and FREE if it has all six, ENCLOSED if all 26 nodes around it exist.
    """
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
    flags[:-1] = (neighbours < len(ijk)).all(1) * (ROW | FREE) + _enclosed(neighbours) * ENCLOSED
    return neighbours, flags


def _enclosed(neighbours: Tensor) -> Tensor:
    """(N,) bool: whether all 26 nodes around each exist."""
    count = len(neighbours)
    table = torch.cat([neighbours, neighbours.new_full((1, 6), count)])
    whole = (neighbours < count).all(1)
    for x in (0, 1):
        whole &= (table[neighbours[:, x], 2:] < count).all(1)
    for y in (2, 3):
        whole &= (table[neighbours[:, y], 4:] < count).all(1)
        for x in (0, 1):
            whole &= (table[table[neighbours[:, x], y], 4:] < count).all(1)
    return whole


def free_runs(neighbours: Tensor, flags: Tensor, slabs: Tensor) -> tuple[Tensor, Tensor]:
    """The runs (R, 6) int64 of consecutive free nodes: start, stop, and the ways −x, +x, −y, +y.

    And (side + 1,) int64: the first run of each i-slab, of which ``slabs`` are the first nodes.
    A way is what to add to a node's index for its neighbour's; it is the same all along a run,
    since nodes are sorted by (i, j, k) and a free node has all its neighbours. ∓z is ∓1.
    """
    free = (flags & FREE).bool().long()
    edges = torch.diff(free, prepend=free.new_zeros(1))
    starts, stops = (edges == 1).nonzero()[:, 0], (edges == -1).nonzero()[:, 0]
    ways = neighbours[starts, :4].long() - starts[:, None]
    runs = torch.cat([starts[:, None], stops[:, None], ways], 1)
    return runs, torch.searchsorted(starts, slabs.contiguous())


def refine(
    ijk: Tensor,
    columns: Tensor,
    neighbours: Tensor,
    values: Tensor,
    carried: Tensor,
    side: int,
    limit: float,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The nodes of the next level, 2·side − 1 an axis: ijk, columns, values (N' + 1,)
    and carried (2, N' + 1).

    A node is kept when all its parents exist (1, 2, 4 or 8, whose means are its own) and either
    |value| < limit or all its parents are corners of voxels in which the sign changes: of these,
    however steep the values are, all children are there.
    """
    corners = all_voxels(neighbours)
    negative = (values[corners] < 0).sum(1)
    crossed = torch.zeros(len(ijk) + 1, dtype=torch.bool, device=ijk.device)
    crossed[corners[(negative > 0) & (negative < 8)]] = True
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
    keep = (index < len(ijk)).all(1)
    keep &= (mean.abs() < limit) | crossed[index].all(1)
    fine, mean, rest = fine[keep], mean[keep], carried[:, index[keep]].mean(2)
    column = fine[:, 0] * fine_side + fine[:, 1]
    count = torch.bincount(column, minlength=fine_side**2)
    starts = torch.cat([count.new_zeros(1), count.cumsum(0)])
    values, carried = (torch.nn.functional.pad(each, (0, 1)) for each in (mean, rest))
    return fine.to(torch.int16), starts, values, carried


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


def all_voxels(neighbours: Tensor) -> Tensor:
    return voxel_corners(neighbours, torch.arange(len(neighbours), device=neighbours.device)).long()
