"""Random inputs of every kernel, on topologies that are built here by brute force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from visco_core.confidence import cluster_points
from visco_core.extract import EDGES, case_table
from visco_core.kernels import ENCLOSED, FREE, ROW

CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(-1, 3)


@dataclass(frozen=True)
class Nodes:
    """A set of nodes, its topology and random values on it, as ``reference`` describes them."""

    side: int
    ijk: np.ndarray
    columns: np.ndarray
    neighbours: np.ndarray
    complete: np.ndarray
    enclosed: np.ndarray
    seed: int
    rng: np.random.Generator = field(repr=False)

    def __len__(self) -> int:
        return len(self.ijk)

    @property
    def slabs(self) -> np.ndarray:
        return self.columns[:: self.side]

    @property
    def full_flags(self) -> np.ndarray:
        flags = self.complete * (ROW | FREE) + self.enclosed * ENCLOSED
        return np.append(flags, 0).astype(np.uint8)

    @property
    def runs(self) -> np.ndarray:
        """Start, stop and ways of each stretch of complete nodes, cut in two where it is long."""
        node = np.flatnonzero(self.complete)
        stretches = np.split(node, np.flatnonzero(np.diff(node) > 1) + 1) if len(node) else []
        pieces = [piece for s in stretches for piece in np.array_split(s, 2) if len(piece)]
        starts = np.array([piece[0] for piece in pieces], np.int64)
        stops = np.array([piece[-1] + 1 for piece in pieces], np.int64)
        return np.column_stack([starts, stops, self.neighbours[starts, :4] - starts[:, None]])

    def flags(self) -> np.ndarray:
        """Flags with some rows and some free nodes taken away, independently."""
        dropped = self.rng.choice([0, ROW, FREE], len(self) + 1, p=[0.6, 0.2, 0.2])
        return (self.full_flags & ~dropped).astype(np.uint8)

    def vector(self, *columns: int) -> np.ndarray:
        """A random vector (N + 1, *columns) over the nodes; the last entry is zero."""
        values = self.rng.standard_normal((len(self) + 1, *columns)).astype(np.float32)
        values[-1] = 0
        return values


def nodes_of(mask: np.ndarray, seed: int = 0) -> Nodes:
    """The nodes of a cube where ``mask`` (side, side, side) is true."""
    side = len(mask)
    ijk = np.argwhere(mask)
    index = np.full((side + 2,) * 3, len(ijk))
    index[tuple((ijk + 1).T)] = np.arange(len(ijk))
    steps = [sign * step for step in np.eye(3, dtype=int) for sign in (-1, 1)]
    neighbours = np.stack([index[tuple((ijk + 1 + step).T)] for step in steps], 1)
    around = [index[tuple((ijk + shift).T)] for shift in np.ndindex(3, 3, 3)]
    column = ijk[:, 0] * side + ijk[:, 1]
    return Nodes(
        side=side,
        ijk=ijk.astype(np.int16),
        columns=np.searchsorted(column, np.arange(side**2 + 1)),
        neighbours=neighbours.astype(np.int32),
        complete=(neighbours < len(ijk)).all(1),
        enclosed=(np.stack(around) < len(ijk)).all(0),
        seed=seed,
        rng=np.random.default_rng(seed),
    )


def dense() -> Nodes:
    return nodes_of(np.ones((17, 17, 17), bool))


def band() -> Nodes:
    """A narrow band around a sphere, as refinement leaves it."""
    ticks = np.linspace(-0.5, 0.5, 33)
    x, y, z = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    return nodes_of(np.abs(np.sqrt(x**2 + y**2 + z**2) - 0.3) < 0.1)


def ragged() -> Nodes:
    """Three quarters of the nodes at random; one slab and some columns are empty."""
    mask = np.random.default_rng(5).random((14, 14, 14)) < 0.75
    mask[6] = False
    mask[2, ::3] = False
    return nodes_of(mask)


def scattered() -> Nodes:
    """Few nodes, hardly one beside another, no whole voxel and so no points."""
    return nodes_of(np.random.default_rng(6).random((14, 14, 14)) < 0.1)


TOPOLOGIES = {"dense": dense, "band": band, "ragged": ragged, "scattered": scattered}


def corners_of(nodes: Nodes, base: np.ndarray) -> np.ndarray:
    """The eight nodes (M, 8) of the voxels above nodes ``base`` (M,), N where one is missing."""
    places = {tuple(map(int, node)): n for n, node in enumerate(nodes.ijk)}
    return np.array(
        [
            [places.get(tuple(map(int, nodes.ijk[b] + corner)), len(nodes)) for corner in CORNERS]
            for b in base
        ],
        np.int32,
    )


@dataclass(frozen=True)
class Scan:
    """Random points in a random half of the whole voxels; some voxels are empty."""

    corners: np.ndarray
    starts: np.ndarray
    local: np.ndarray
    normals: np.ndarray
    slabs: np.ndarray
    matrices: np.ndarray


def diagonals_of(whole: np.ndarray) -> np.ndarray:
    """The cyclic diagonals (M, 5, 8) of symmetric matrices (M, 8, 8)."""
    r = np.arange(8)
    return np.stack([whole[:, r, (r + k) % 8] for k in range(5)], 1)


def whole_of(diagonals: np.ndarray) -> np.ndarray:
    """The inverse of ``diagonals_of``."""
    whole, r = np.empty((len(diagonals), 8, 8), diagonals.dtype), np.arange(8)
    for k in range(5):
        whole[:, r, (r + k) % 8] = whole[:, (r + k) % 8, r] = diagonals[:, k]
    return whole


def scan_on(nodes: Nodes) -> Scan:
    rng = nodes.rng
    corners = corners_of(nodes, np.flatnonzero(rng.random(len(nodes)) < 0.5))
    corners = corners[(corners < len(nodes)).all(1)]
    counts = rng.integers(0, 4, len(corners))
    local = rng.random((counts.sum(), 3)).astype(np.float32)
    normals = rng.standard_normal(local.shape)
    rows = rng.standard_normal((len(corners), 3, 8)).astype(np.float32)
    return Scan(
        corners=corners,
        starts=np.append(0, np.cumsum(counts)),
        local=local,
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        slabs=np.searchsorted(nodes.ijk[corners[:, 0], 0], np.arange(nodes.side + 1)),
        matrices=diagonals_of(np.einsum("mkr,mkc->mrc", rows, rows)),
    )


HALF_INVERSE, LAPLACE, SCALE = np.float32(8), np.float32(2.5), np.float32(0.3)


def _linearise(n: Nodes) -> tuple[Any, ...]:
    outputs = n.vector(3).T.copy(), n.vector()
    return n.vector(), n.vector(), n.vector() ** 2, n.runs, HALF_INVERSE, LAPLACE, *outputs


def _operate(n: Nodes) -> tuple[Any, ...]:
    """With v and the rows zero off the free nodes."""
    s, runs = scan_on(n), n.runs
    slopes, stiffness = n.vector(3).T.copy(), n.vector() ** 2
    rows = slopes, stiffness, runs, np.searchsorted(runs[:, 0], n.slabs), LAPLACE, SCALE
    points = s.corners, s.matrices, s.slabs, n.full_flags
    return n.vector() * (n.full_flags > 0), *rows, *points, 0 * n.vector(), 0 * n.vector()


def _viscosity_columns(n: Nodes) -> tuple[Any, ...]:
    return n.vector(), n.vector(3).T.copy(), n.runs, LAPLACE, SCALE, n.vector()


def _viscosity_diagonal(n: Nodes) -> tuple[Any, ...]:
    stiffness = n.vector() ** 2
    return n.vector(3).T.copy(), stiffness, n.runs, n.flags(), LAPLACE, SCALE, n.vector()


def _point_system(n: Nodes) -> tuple[Any, ...]:
    s = scan_on(n)
    return s.local, s.normals, s.starts, n.side - 1, 0.7, 0.02


def _point_sums(n: Nodes) -> tuple[Any, ...]:
    s = scan_on(n)
    return n.vector(), s.corners, s.local, s.normals, s.starts, n.side - 1


def _point_matvec(n: Nodes) -> tuple[Any, ...]:
    s = scan_on(n)
    return n.vector(), s.corners, s.matrices, s.slabs, n.flags(), n.vector()


def _scatter(n: Nodes) -> tuple[Any, ...]:
    s = scan_on(n)
    return n.rng.random(s.corners.shape, np.float32), s.corners, s.slabs, n.flags(), n.vector()


def _coarea(n: Nodes) -> tuple[Any, ...]:
    constants = np.float32(n.side - 1), np.float32(0.6), SCALE
    return n.vector(), n.neighbours, n.slabs, n.flags(), *constants, n.vector()


def _squared_distance(n: Nodes) -> tuple[Any, ...]:
    return (n.rng.random((n.side,) * 3) < 0.97,)


def _spline_prolong(n: Nodes) -> tuple[Any, ...]:
    coarse = n.rng.standard_normal((n.side // 2 + 1,) * 3)
    return coarse.astype(np.float32), n.side


def _spline_restrict(n: Nodes) -> tuple[Any, ...]:
    return (n.rng.standard_normal((n.side,) * 3).astype(np.float32),)


def _spline_correct(n: Nodes) -> tuple[Any, ...]:
    coarse = n.rng.standard_normal((n.side // 2 + 1,) * 3).astype(np.float32)
    r, z = (np.append(n.rng.standard_normal(n.side**3), 0).astype(np.float32) for _ in range(2))
    return coarse, n.side, r, z


def _spline_energies(n: Nodes) -> tuple[Any, ...]:
    s = scan_on(n)
    basis = n.rng.random(13).astype(np.float32)
    return s.corners, s.matrices, s.slabs, n.ijk, basis, 4, (n.side - 2) // 4 + 2


def _dot(n: Nodes) -> tuple[Any, ...]:
    return n.vector(), n.vector()


def _cg_advance(n: Nodes) -> tuple[Any, ...]:
    vectors = (n.vector() for _ in range(4))
    return *vectors, np.float32(0.4), n.vector(), n.vector()


def _cg_direction(n: Nodes) -> tuple[Any, ...]:
    return n.vector(), n.vector(), np.float32(0.4)


def _splat_divergence(n: Nodes) -> tuple[Any, ...]:
    points = n.rng.random((500, 3), np.float32)
    points[:8] = CORNERS
    return points, n.rng.standard_normal((500, 3)).astype(np.float32), n.side


def _sample(n: Nodes) -> tuple[Any, ...]:
    return 10 * len(n), 0.3, 2**31 + len(n)


def _adam_advance(n: Nodes) -> tuple[Any, ...]:
    constants = np.float32([2e-3, 0.02, 0.9, 0.999, 1e-8])
    return n.vector(), n.vector(), n.vector(), np.abs(n.vector()), *constants


def _find_nodes(n: Nodes) -> tuple[Any, ...]:
    query = n.rng.integers(0, n.side, (2000, 3), np.int32)
    return query, n.ijk, n.columns, n.side


def _neighbour_table(n: Nodes) -> tuple[Any, ...]:
    return n.ijk, n.columns, n.side


def _free_runs(n: Nodes) -> tuple[Any, ...]:
    return n.neighbours, n.full_flags, n.slabs


def _refine(n: Nodes) -> tuple[Any, ...]:
    carried = n.vector(2).T.copy()
    return n.ijk, n.columns, n.neighbours, n.vector(), carried, n.side, 0.2


def _voxel_corners(n: Nodes) -> tuple[Any, ...]:
    base = n.rng.integers(0, len(n) + 1, 1500, np.int32)
    return n.neighbours, base


def _surface_counts(n: Nodes) -> tuple[Any, ...]:
    return n.vector(), n.neighbours, case_table()[0]


def _surface_vertices(n: Nodes) -> tuple[Any, ...]:
    values = n.vector()
    return values, n.ijk, n.neighbours, starts_of_surface(n, values)[0]


def _surface_faces(n: Nodes) -> tuple[Any, ...]:
    values = n.vector()
    owner, axis = np.array(EDGES, np.uint8).T
    starts = starts_of_surface(n, values)
    return values, n.neighbours, *starts, case_table()[1], owner.copy(), axis.copy()


def _support(n: Nodes) -> tuple[Any, ...]:
    points, places = n.rng.random((3000, 3)) ** 2, n.rng.random((1000, 3)).astype(np.float32)
    normals, directions = (n.rng.standard_normal(a.shape) for a in (points, places))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    clusters = cluster_points(points, normals, 17)
    clusters.rows[:, -1] = n.rng.random(len(clusters.rows))
    return places, directions.astype(np.float32), *clusters.tables, 8.0


def starts_of_surface(nodes: Nodes, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each node's cut edges and its voxel's triangles start, both (N + 1,)."""
    missing = len(nodes)
    high = nodes.neighbours[:, 1::2]
    cut = (high < missing) & ((values[high] < 0) != (values[:-1, None] < 0))
    corners = corners_of(nodes, np.arange(missing))
    whole = (corners < missing).all(1)
    case = ((values[corners] < 0) << np.arange(8)).sum(1) * whole
    triangles = case_table()[0][case].astype(np.int64)
    return np.append(0, np.cumsum(cut.sum(1))), np.append(0, np.cumsum(triangles))


INPUTS: dict[str, Callable[[Nodes], tuple[Any, ...]]] = {
    maker.__name__[1:]: maker
    for maker in (
        _linearise,
        _operate,
        _viscosity_columns,
        _viscosity_diagonal,
        _point_system,
        _point_sums,
        _point_matvec,
        _scatter,
        _coarea,
        _squared_distance,
        _spline_prolong,
        _spline_restrict,
        _spline_correct,
        _spline_energies,
        _dot,
        _cg_advance,
        _cg_direction,
        _splat_divergence,
        _sample,
        _adam_advance,
        _find_nodes,
        _neighbour_table,
        _free_runs,
        _refine,
        _voxel_corners,
        _surface_counts,
        _surface_vertices,
        _surface_faces,
        _support,
    )
}
"""Kernel → arguments for it on some nodes."""
