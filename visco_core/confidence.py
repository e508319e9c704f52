"""How well the scan supports each vertex of a mesh.

The density of points around the vertex is compared with the density that those points find around
themselves, after the local outlier factor (Breunig, Kriegel, Ng, Sander, *LOF: Identifying
Density-Based Local Outliers*, SIGMOD 2000), so that no unit, spacing or noise need be known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.facing import nearest_axis
from visco_core.io.faces import vertex_normals
from visco_core.kernels import Backend
from visco_core.progress import Check, never
from visco_core.result import Mesh

ENOUGH = 8.0
"""Points, counted by their nearness, that say how dense the scan is at a place: in an evenly
sampled plane, the weights of the 16 nearest add up to it."""

CELL = 3
"""Voxels: the least radius looked at. Gaps narrower than this are closed by the solver's own
smoothness."""

PIECE = 2**18
"""Vertices between two questions for a stop request: about 50 ms of work."""

_FACINGS = 6
_COUNT, _PLACE, _NORMAL, _SPACING = 0, slice(1, 4), slice(4, 7), 7


def confidence(
    mesh: Mesh,
    points: np.ndarray,
    normals: np.ndarray,
    resolution: int,
    backend: Backend,
    check: Check = never,
) -> np.ndarray:
    """(V,) float32 in [0, 1]: 1 where points surround the vertex and face its way, 0 far from any.

        c(v) = min(1, s̄² / r(v)²) · max(0, 2a − 1)

    Only points whose normals face the vertex's way count, so the far side of a thin wall does not.
    r(x) is the radius at which Σ (1 − |x − q|²/r²)₊ reaches ENOUGH, s̄² the mean of r(q)² over the
    points within r(v), with the same weights, and a the mean cosine between their normals and the
    vertex's. So s̄²/r² is the density of the surface's samples at the vertex over that at the
    samples themselves: about ½ at the rim of a hole, falling with the square of the distance
    beyond it. Normals at random have a = ½, which gives 0. A stray point among ENOUGH others
    counts as one of them.

    ``mesh`` and points (P, 3) in the unit cube; normals (P, 3) unit, outward; resolution in voxels.
    r is CELL voxels at least, and points within a cell as large as r, facing the same axis, count
    together at their mean.
    """
    clusters = cluster_points(points, normals, -(-resolution // CELL), check)
    finest = clusters.rows[: clusters.sizes[0]]
    facing = finest[:, _NORMAL] / finest[:, :1]
    reach = _support(clusters, finest[:, _PLACE], facing, backend, check)[:, 0]
    _fill(clusters, reach * finest[:, _COUNT], check)
    directions = mesh.normals
    if directions is None:
        directions = vertex_normals(mesh.vertices, mesh.faces)
    reach, spacing, cosine = _support(clusters, mesh.vertices, directions, backend, check).T
    return np.minimum(1, spacing / reach) * np.maximum(0, 2 * cosine - 1)


@dataclass(frozen=True)
class Clusters:
    """The points of cells, coarser and coarser; level l has sides[l]³ cells, and sizes[l] clusters.

    columns, depths, rows: as the kernel ``support`` has them. parents: for each level but the last,
    the cluster of the next one that each of its clusters is part of.
    """

    sides: list[int]
    sizes: list[int]
    columns: np.ndarray
    depths: np.ndarray
    rows: np.ndarray
    parents: list[np.ndarray]

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """sides, columns, depths and rows: what the kernel looks up in."""
        return np.array(self.sides), self.columns, self.depths, self.rows


def cluster_points(
    points: np.ndarray, normals: np.ndarray, side: int, check: Check = never
) -> Clusters:
    """Clusters of the points of a cell whose normals are nearest to the same of the six axes."""
    cells = np.clip((points * side).astype(np.int64), 0, side - 1)
    keys = _keys(cells, side, nearest_axis(normals))
    check()
    order = np.argsort(keys, kind="stable")
    check()
    keys = keys[order]
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    each = np.zeros((len(points), 8), np.float32)
    each[:, _COUNT], each[:, _PLACE], each[:, _NORMAL] = 1, points[order], normals[order]
    check()
    rows, keys = np.add.reduceat(each, first), keys[first]
    sides, levels, parents = [side], [(keys, rows)], []
    while side > 2:
        check()
        cells, facing = _cells(keys, side)
        side = (side + 1) // 2
        keys, parent = np.unique(_keys(cells // 2, side, facing), return_inverse=True)
        rows = _summed(rows, parent, len(keys))
        sides.append(side)
        levels.append((keys, rows))
        parents.append(parent)
    ends = np.cumsum([0, *(len(keys) for keys, _ in levels)])
    columns = [
        end + np.searchsorted(keys, np.arange(side**2 + 1) * side * _FACINGS)
        for end, side, (keys, _) in zip(ends, sides, levels, strict=False)
    ]
    depths = [_cells(keys, side)[0][:, 2] for side, (keys, _) in zip(sides, levels, strict=True)]
    rows = np.concatenate([rows for _, rows in levels])
    rows[:, _PLACE] /= rows[:, :1]
    return Clusters(
        sides,
        [len(keys) for keys, _ in levels],
        np.concatenate(columns).astype(np.int32),
        np.concatenate(depths).astype(np.int32),
        rows,
        parents,
    )


def _keys(cells: np.ndarray, side: int, facing: np.ndarray) -> np.ndarray:
    """(C,) int64, in whose order cells (C, 3) of a column follow one another."""
    return np.ravel_multi_index((*cells.T, facing), (side, side, side, _FACINGS))


def _cells(keys: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of ``_keys``."""
    *cells, facing = np.unravel_index(keys, (side, side, side, _FACINGS))
    return np.stack(cells, 1), facing


def _summed(rows: np.ndarray, parent: np.ndarray, count: int) -> np.ndarray:
    sums = [np.bincount(parent, column, count) for column in rows.T]
    return np.stack(sums, 1).astype(np.float32)


def _fill(clusters: Clusters, spacing: np.ndarray, check: Check) -> None:
    """Sets the sum of spacing² (C,) of the finest clusters, and those of all the coarser ones."""
    start = 0
    for level, size in enumerate(clusters.sizes):
        check()
        clusters.rows[start : start + size, _SPACING] = spacing
        start += size
        if level < len(clusters.parents):
            spacing = np.bincount(clusters.parents[level], spacing, clusters.sizes[level + 1])


def _support(
    clusters: Clusters,
    places: np.ndarray,
    directions: np.ndarray,
    backend: Backend,
    check: Check,
) -> np.ndarray:
    """Radius², mean spacing² and mean cosine (Q, 3) at places (Q, 3), looked up in pieces."""
    tables = [backend.array(table) for table in clusters.tables]
    found = np.empty((len(places), 3), np.float32)
    for start in range(0, len(places), PIECE):
        check()
        part = slice(start, start + PIECE)
        where = [backend.array(a[part].astype(np.float32)) for a in (places, directions)]
        found[part] = backend.numpy(backend.kernels.support(*where, *tables, ENOUGH))
    return found
