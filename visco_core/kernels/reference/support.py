"""Plain kernel of how densely a scan's points lie around a place."""

from __future__ import annotations

import torch
from torch import Tensor

PIECE = 2**14
"""Places at a time: each meets dozens of clusters."""


def support(
    places: Tensor,
    directions: Tensor,
    sides: Tensor,
    columns: Tensor,
    depths: Tensor,
    clusters: Tensor,
    enough: float,
) -> Tensor:
    """Radius², mean of the clusters' spacing², and mean cosine around each place: (Q, 3).

    At a radius r every cluster that faces the place's way counts with (1 − d²/r²)₊ times its
    points, d being its distance. The radius is where they reach ``enough``, linear between those
    of the levels and not below the first; the means are over the clusters within it.

    places, directions (Q, 3) float32: in the unit cube, and unit vectors. On each level the cube
    has sides[level]³ cells as large as the level's radius. columns: for each level the side² + 1
    starts of its (i, j) columns among the clusters, of which depths (C,) int32 is k.
    clusters (C, 8) float32: number of points, mean position (3), sum of normals (3), sum of
    spacing².
    """
    parts = zip(places.split(PIECE), directions.split(PIECE), strict=True)
    levels = (columns.split([int(side) ** 2 + 1 for side in sides]), depths, clusters)
    found = [_support(*part, sides.tolist(), *levels, enough) for part in parts]
    return torch.cat(found) if found else places.new_zeros((0, 3))


def _support(
    places: Tensor,
    directions: Tensor,
    sides: list[int],
    columns: tuple[Tensor, ...],
    depths: Tensor,
    clusters: Tensor,
    enough: float,
) -> Tensor:
    out = places.new_zeros((len(places), 3))
    left = torch.arange(len(places), device=places.device)
    before = places.new_zeros((len(places), 3))
    for level, side in enumerate(sides):
        radius = 2.0**level / sides[0]
        found = _sums_within(
            places[left], directions[left], radius, side, columns[level], depths, clusters
        )
        done = (found[:, 0] >= enough) | (level == len(sides) - 1)
        share = torch.ones_like(found[:, 0])
        if level > 0:
            more = found[:, 0] > enough
            gap = torch.where(more, found[:, 0] - before[:, 0], 1.0)
            share = torch.where(more, (enough - before[:, 0]) / gap, 1.0)
        reached = radius * (1 + share) / 2 if level > 0 else radius * share
        sums = before + share[:, None] * (found - before)
        means = sums[:, 1:] / sums[:, :1].clamp_min(1e-30)
        out[left[done]] = torch.cat([reached[:, None] ** 2, means], 1)[done]
        left, before = left[~done], found[~done]
    return out


def _sums_within(
    places: Tensor,
    directions: Tensor,
    radius: float,
    side: int,
    columns: Tensor,
    depths: Tensor,
    clusters: Tensor,
) -> Tensor:
    """Weight, weighted spacing² and weighted cosine (Q, 3) of one level."""
    sums = places.new_zeros((len(places), 3))
    cell = (places / radius).int().clamp(0, side - 1).long()
    low, high = (cell[:, 1] - 1).clamp_min(0), (cell[:, 1] + 2).clamp_max(side)
    for step in (-1, 0, 1):
        slab = cell[:, 0] + step
        row = slab.clamp(0, side - 1) * side
        start = columns[row + low].long()
        count = (columns[row + high].long() - start) * ((slab >= 0) & (slab < side))
        place = torch.repeat_interleave(torch.arange(len(places), device=places.device), count)
        within = torch.arange(len(place), device=places.device) - (count.cumsum(0) - count)[place]
        cluster = start[place] + within
        near = (depths[cluster] - cell[place, 2]).abs() <= 1
        place, cluster = place[near], cluster[near]
        taken = clusters[cluster]
        distance = (taken[:, 1:4] - places[place]).square().sum(1)
        facing = (taken[:, 4:7] * directions[place]).sum(1)
        weight = (1 - distance / radius**2).clamp_min(0) * (facing > 0)
        terms = weight[:, None] * torch.stack([taken[:, 0], taken[:, 7], facing], 1)
        sums.index_add_(0, place, terms)
    return sums
