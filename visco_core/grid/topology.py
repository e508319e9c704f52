"""Which nodes exist and who is beside whom; values live elsewhere.

A grid of ``side`` nodes an axis spans the unit cube with spacing 1 / (side − 1). The coarsest level
has all its nodes, finer ones only a band around the surface. Levels nest: a grid of side n refines
to 2n − 1, and every coarse node is a fine one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.kernels import ENCLOSED, Array, Backend


@dataclass(frozen=True)
class Grid:
    """The nodes of one level, sorted by (i, j, k).

    ijk (N, 3) int16; columns (side² + 1,) int64, the start of each (i, j) column;
    neighbours (N, 6) int32 in the order −x, +x, −y, +y, −z, +z, N where there is none;
    flags (N + 1,) uint8; runs (R, 6) and run_slabs (side + 1,) int64 as ``kernels.free_runs`` makes
    them. A node on the rim, that lacks a neighbour, is neither ROW nor FREE: its value is fixed and
    bounds the solve (Dirichlet).
    """

    backend: Backend
    side: int
    ijk: Array
    columns: Array
    neighbours: Array
    flags: Array
    runs: Array
    run_slabs: Array

    def __len__(self) -> int:
        return len(self.ijk)

    @property
    def resolution(self) -> int:
        """Voxels an axis."""
        return self.side - 1

    @property
    def is_dense(self) -> bool:
        """Whether every node of the cube is there."""
        return len(self) == self.side**3

    @property
    def slabs(self) -> Array:
        """(side + 1,) int64: where the nodes of each i start."""
        return self.columns[:: self.side]


def _grid(backend: Backend, side: int, ijk: Array, columns: Array) -> Grid:
    neighbours, flags = backend.kernels.neighbour_table(ijk, columns, side)
    runs, run_slabs = backend.kernels.free_runs(neighbours, flags, columns[::side])
    return Grid(backend, side, ijk, columns, neighbours, flags, runs, run_slabs)


def dense_grid(backend: Backend, side: int) -> Grid:
    """Every node of the cube."""
    ticks = np.arange(side, dtype=np.int16)
    ijk = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3)
    columns = np.arange(0, side**3 + 1, side, dtype=np.int64)
    return _grid(backend, side, backend.array(ijk), backend.array(columns))


def refine(
    grid: Grid, values: Array, carried: Array, band_width: float
) -> tuple[Grid, Array, Array]:
    """The next level's band, ``values`` (N' + 1,) and ``carried`` (2, N' + 1) interpolated on it.

    Keeps the nodes with |f| below ``band_width`` fine voxels, and all in the voxels where the sign
    changes.
    """
    side = 2 * grid.side - 1
    fields = values, carried, grid.side, band_width / (side - 1)
    ijk, columns, *fine = grid.backend.kernels.refine(
        grid.ijk, grid.columns, grid.neighbours, *fields
    )
    return _grid(grid.backend, side, ijk, columns), *fine


def keep_closed(grid: Grid, before: Array, after: Array) -> Array:
    """``after`` (N + 1,) with a surface that is as closed as that of ``before`` (N + 1,).

    Nodes that lack one of the 26 around them keep the sign that they had, and so their old value
    where it has changed. Then all voxels around an edge of the grid that the surface cuts are
    there: either one of its ends has all, or they were there before.
    """
    changed = (before < 0) != (after < 0)
    held = changed & ((grid.flags & ENCLOSED) == 0)
    after = after + 0
    after[held] = before[held]
    return after


def voxel_corners(grid: Grid, voxels: Array) -> Array:
    """The eight nodes (M, 8) int32 of voxels given by their lowest (i, j, k).

    All eight are N where one is missing.
    """
    kernels = grid.backend.kernels
    base = kernels.find_nodes(voxels, grid.ijk, grid.columns, grid.side)
    return kernels.voxel_corners(grid.neighbours, base)
