"""The zero level set of a narrow band as a triangle mesh.

Marching cubes over the band's voxels. The case table is derived here instead of being listed: on
every face of a voxel the cut edges are joined so that negative corners are separated, which depends
on that face alone, so neighbouring voxels agree and the surface has no cracks; the segments are
chained into loops, and a loop is triangulated without a chord inside a face, since such a chord
could meet a second one from the other side and leave an edge with four triangles.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from visco_core.grid.samples import Samples
from visco_core.grid.topology import Grid
from visco_core.kernels import Array, Backend
from visco_core.kernels.native import label_pieces

# A corner is 4·x + 2·y + z; an edge is its lower corner and its axis.
EDGES = tuple((c, axis) for axis in range(3) for c in range(8) if not c & (4 >> axis))
_EDGE_OF = {(c, c | (4 >> axis)): e for e, (c, axis) in enumerate(EDGES)}
MAX_TRIANGLES = 5


def _faces() -> Iterator[tuple[int, int, int, int]]:
    """The corners of each face in a cycle, counter-clockwise seen from outside."""
    for axis in range(3):
        u, v = 4 >> (axis + 1) % 3, 4 >> (axis + 2) % 3
        yield (0, v, u | v, u)
        high = 4 >> axis
        yield (high, high | u, high | u | v, high | v)


def _edge(a: int, b: int) -> int:
    return _EDGE_OF[min(a, b), max(a, b)]


def _loops(case: int) -> list[list[int]]:
    """The loops of cut edges in a voxel whose negative corners are the bits of ``case``."""
    following = {}
    for face in _faces():
        inside = [bool(case >> corner & 1) for corner in face]
        for start in range(4):
            if inside[start] and not inside[start - 1]:
                stop = start
                while inside[(stop + 1) % 4]:
                    stop += 1
                enter = _edge(face[start - 1], face[start])
                leave = _edge(face[stop % 4], face[(stop + 1) % 4])
                following[enter] = leave
    loops = []
    while following:
        loop = [next(iter(following))]
        while (edge := following.pop(loop[-1])) != loop[0]:
            loop.append(edge)
        loops.append(loop)
    return loops


def _triangulations(loop: list[int]) -> Iterator[list[tuple[int, int, int]]]:
    if len(loop) < 3:
        yield []
        return
    for apex in range(1, len(loop) - 1):
        for left in _triangulations(loop[: apex + 1]):
            for right in _triangulations(loop[apex:]):
                yield [*left, (loop[0], loop[apex], loop[-1]), *right]


def _triangulated(loop: list[int]) -> list[tuple[int, int, int]]:
    """The first triangulation whose chords, sides that are none of the loop, lie in no face."""
    sides = {frozenset(pair) for pair in zip(loop, loop[1:] + loop[:1], strict=True)}
    barred = _pairs_in_a_face() - sides
    return next(
        triangles
        for triangles in _triangulations(loop)
        if not any(frozenset((t[k], t[k - 1])) in barred for t in triangles for k in range(3))
    )


@functools.cache
def _pairs_in_a_face() -> set[frozenset[int]]:
    """Every two edges of a voxel that bound the same face."""
    rings = [[_edge(face[k], face[k - 1]) for k in range(4)] for face in _faces()]
    return {frozenset(pair) for ring in rings for pair in itertools.combinations(ring, 2)}


@functools.cache
def case_table() -> tuple[np.ndarray, np.ndarray]:
    """(256,) triangle counts and (256, MAX_TRIANGLES, 3) edges of the triangles, both uint8."""
    counts = np.zeros(256, np.uint8)
    table = np.zeros((256, MAX_TRIANGLES, 3), np.uint8)
    for case in range(256):
        triangles = [triangle for loop in _loops(case) for triangle in _triangulated(loop)]
        counts[case] = len(triangles)
        for row, triangle in enumerate(triangles):
            table[case, row] = triangle
    return counts, table


@dataclass(frozen=True)
class Isosurface:
    """Triangles in the grid's unit cube, and which node's edge each vertex lies on.

    vertices (V, 3) float64 in [0, 1]³; normals (V, 3) float32, unit, towards growing values;
    faces (F, 3) int32; first_vertex (N + 1,) int64: the first vertex of each node's edges.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    first_vertex: np.ndarray


def extract_isosurface(grid: Grid, values: Array) -> Isosurface:
    """The zero level set of ``values`` (N + 1,) in the voxels of ``grid``.

    Manifold; closed unless the surface leaves the grid. A vertex lies on its edge where the
    trilinear interpolant is zero, kept 1e-4 of the edge away from the nodes so that no triangle
    degenerates.
    """
    backend = grid.backend
    kernels = backend.kernels
    counts, edges = case_table()
    cut, triangles = kernels.surface_counts(values, grid.neighbours, backend.array(counts))
    first_vertex, first_triangle = backend.starts(cut), backend.starts(triangles)
    vertices, normals = kernels.surface_vertices(values, grid.ijk, grid.neighbours, first_vertex)
    owner, axis = np.array(EDGES, np.uint8).T
    faces = kernels.surface_faces(
        values,
        grid.neighbours,
        first_vertex,
        first_triangle,
        backend.array(edges),
        backend.array(owner),
        backend.array(axis),
    )
    return Isosurface(
        backend.numpy(vertices).astype(np.float64) / grid.resolution,
        backend.numpy(normals),
        backend.numpy(faces),
        backend.numpy(first_vertex),
    )


def supported_pieces(surface: Isosurface, samples: Samples, backend: Backend) -> Isosurface:
    """``surface`` without the connected pieces that too few points of the scan touch.

    A piece is supported by the points in the voxels that hold one of its vertices. It stays if
    they are at least 16 and 2 in 10,000 of all, or if no piece has more.
    """
    pieces = label_pieces(surface.faces, len(surface.vertices))
    corners = backend.numpy(samples.corners)
    counts = np.diff(backend.numpy(samples.starts))
    first = surface.first_vertex
    has_vertex = np.append(first[1:] > first[:-1], False)[corners]
    voxel = np.flatnonzero(has_vertex.any(1))
    node = corners[voxel, has_vertex[voxel].argmax(1)]
    support = np.bincount(pieces[first[node]], counts[voxel], minlength=pieces.max(initial=0) + 1)
    needed = min(max(16, 2e-4 * samples.total), support.max(initial=0))
    return _keep_vertices(surface, (support >= needed)[pieces])


def _keep_vertices(surface: Isosurface, keep: np.ndarray) -> Isosurface:
    if keep.all():
        return surface
    renumbered = np.append(0, np.cumsum(keep))
    faces = renumbered[:-1].astype(np.int32)[surface.faces[keep[surface.faces[:, 0]]]]
    return Isosurface(
        surface.vertices[keep],
        surface.normals[keep],
        faces,
        renumbered[surface.first_vertex],
    )
