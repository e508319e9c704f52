"""Whether a mesh is one clean surface: what every tool behind it relies on."""

from __future__ import annotations

from typing import Any

import numpy as np

from visco_core.result import Mesh


def mesh_health(mesh: Mesh) -> dict[str, Any]:
    """Counts of what is wrong with a mesh and what shape it has, JSON-able.

    boundary_edges have one face, nonmanifold_edges more than two; a nonmanifold_vertex joins
    several fans of faces. ``oriented``: neighbors agree on their orientation. ``watertight``: no
    edge is of either kind and the faces are oriented. ``outward``: the enclosed volume is
    positive; None for a mesh that is not watertight. ``genus`` sums over the components, None
    where it is not defined. Faces that name a vertex twice are counted and left out.
    """
    faces = np.asarray(mesh.faces, dtype=np.int64)
    collapsed = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    faces = faces[~collapsed]
    edges = _Edges(faces, len(mesh.vertices))
    fans, fan_count = _fans(edges)
    components = _components(fans, fan_count)
    used = len(np.unique(faces))
    manifold = edges.crowded == 0
    watertight = bool(len(faces)) and manifold and edges.boundary == 0 and edges.oriented
    # Cutting a vertex apart into its fans leaves a surface whose Euler number tells the genus.
    euler_of_fans = fan_count - edges.count + len(faces)
    genus = None
    if manifold and edges.oriented and len(faces):
        genus = (2 * components - edges.boundary_loops(fans) - euler_of_fans) // 2
    volume = _volume(mesh.vertices, faces)
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "collapsed_faces": int(collapsed.sum()),
        "unused_vertices": len(mesh.vertices) - used,
        "boundary_edges": edges.boundary,
        "nonmanifold_edges": edges.crowded,
        "nonmanifold_vertices": _vertices_with_several_fans(faces, fans),
        "components": components,
        "euler_number": used - edges.count + len(faces),
        "genus": genus,
        "oriented": edges.oriented,
        "watertight": watertight,
        "outward": volume > 0.0 if watertight else None,
        "volume": volume if watertight else None,
    }


class _Edges:
    """The undirected edges of faces (F, 3), and which of them glue two faces together.

    Corner 3f + i is corner i of face f; its half-edge leads to the face's next corner.
    """

    def __init__(self, faces: np.ndarray, vertex_count: int) -> None:
        start = faces.ravel()
        end = np.roll(faces, -1, axis=1).ravel()
        key = np.minimum(start, end) * vertex_count + np.maximum(start, end)
        order = np.argsort(key)
        sorted_key = key[order]
        first = np.flatnonzero(np.diff(sorted_key, prepend=-1))
        sizes = np.diff(first, append=len(order))
        self.corner_count = len(start)
        self.count = len(first)
        self.boundary = int((sizes == 1).sum())
        self.crowded = int((sizes > 2).sum())
        self._single = order[first[sizes == 1]]
        pairs = first[sizes == 2]
        self._left, self._right = order[pairs], order[pairs + 1]
        opposed = start[self._left] == end[self._right]
        self.oriented = bool(opposed.all()) and self.crowded == 0
        self._opposed = opposed

    def glued_corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners of two neighboring faces that lie at one end of their common edge."""
        left, right = self._left, self._right
        right_next = _next_corner(right)
        at_start = np.where(self._opposed, right_next, right)
        at_end = np.where(self._opposed, right, right_next)
        return np.concatenate([left, _next_corner(left)]), np.concatenate([at_start, at_end])

    def boundary_loops(self, fans: np.ndarray) -> int:
        """Number of closed chains of boundary edges."""
        if not self.boundary:
            return 0
        ends = np.stack([fans[self._single], fans[_next_corner(self._single)]])
        names, place = np.unique(ends, return_inverse=True)
        place = place.reshape(ends.shape)
        return _count_connected(place[0], place[1], len(names))[0]


def _next_corner(corner: np.ndarray) -> np.ndarray:
    return np.where(corner % 3 == 2, corner - 2, corner + 1)


def _fans(edges: _Edges) -> tuple[np.ndarray, int]:
    """(fan of each corner (3F,), number of fans): corners at a vertex joined through edges."""
    count, fans = _count_connected(*edges.glued_corners(), edges.corner_count)
    return fans, count


def _components(fans: np.ndarray, fan_count: int) -> int:
    corners = fans.reshape(-1, 3)
    return _count_connected(
        np.concatenate([corners[:, 0], corners[:, 1]]),
        np.concatenate([corners[:, 1], corners[:, 2]]),
        fan_count,
    )[0]


def _vertices_with_several_fans(faces: np.ndarray, fans: np.ndarray) -> int:
    vertex_of_fan = np.zeros(fans.max(initial=-1) + 1, dtype=np.int64)
    vertex_of_fan[fans] = faces.ravel()
    return int((np.bincount(vertex_of_fan) > 1).sum())


def _count_connected(first: np.ndarray, second: np.ndarray, count: int) -> tuple[int, np.ndarray]:
    """(number of connected parts, part of each of ``count`` nodes) of a graph given by its arcs."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not count:
        return 0, np.zeros(0, dtype=np.int32)
    arcs = (np.ones(len(first), dtype=np.int8), (first, second))
    parts, label = connected_components(coo_array(arcs, shape=(count, count)), directed=False)
    return int(parts), label


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume, positive where the faces turn counter-clockwise seen from outside."""
    if not len(faces):
        return 0.0
    a, b, c = np.moveaxis((vertices - vertices.mean(axis=0))[faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6.0)
