"""A mesh cut off where no point supports it, along a smooth border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.errors import InputError
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never
from visco_core.result import Mesh

HALVINGS = 6
"""How often an edge is halved to find where it leaves the distance: to a sixty-fourth of it."""

LEAST_CUT = 0.1
"""Share of an edge that a cut leaves at either end: nearer, it would make slivers."""


def trim(
    mesh: Mesh, points: np.ndarray, distance: float, threads: int = -1, check: Check = never
) -> Mesh:
    """``mesh`` as far as ``distance`` from the nearest of ``points`` (P, 3).

    Faces that reach further are cut, to a tenth of their edges. Only positions and normals are
    kept. Raises InputError (``trim_removes_all``) when nothing would be left.
    """
    look_up = Neighbours(points, threads, check)

    def near(places: np.ndarray) -> np.ndarray:
        return np.isfinite(look_up.nearest(places, within=distance)[0][:, 0])

    kept = near(mesh.vertices)
    check()
    inside = kept[mesh.faces].sum(1)
    if not inside.any():
        raise InputError(
            "trim_removes_all",
            f"Trimming at {distance:g} removes the whole mesh; use a larger one.",
        )
    cuts = _Cuts.of(mesh.faces[(inside == 1) | (inside == 2)], kept, len(mesh.vertices))
    low, high = np.zeros(len(cuts.ends)), np.ones(len(cuts.ends))
    for _ in range(HALVINGS):
        check()
        middle = (low + high) / 2
        reached = near(_between(mesh.vertices, cuts.ends, middle))
        low, high = np.where(reached, middle, low), np.where(reached, high, middle)
    share = np.clip(low, LEAST_CUT, 1 - LEAST_CUT)
    faces = np.concatenate([mesh.faces[inside == 3], cuts.faces])
    used, faces = np.unique(faces, return_inverse=True)

    def kept_of(values: np.ndarray) -> np.ndarray:
        every = np.concatenate([values, _between(values, cuts.ends, share)])
        return every[used]

    normals = None
    if mesh.normals is not None:
        normals = kept_of(mesh.normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        normals = normals.astype(np.float32)
    return Mesh(kept_of(mesh.vertices), faces.reshape(-1, 3).astype(np.int32), normals)


def _between(values: np.ndarray, ends: np.ndarray, share: np.ndarray) -> np.ndarray:
    """``values`` (V, D) at a ``share`` (E,) of the way between the vertices ``ends`` (E, 2)."""
    first, last = values[ends[:, 0]], values[ends[:, 1]]
    return first + share[:, None] * (last - first)


@dataclass(frozen=True)
class _Cuts:
    """ends (E, 2): the kept and the other vertex of each edge that is cut; faces (F, 3): what is
    left of those faces, in which V + e is the vertex on edge e."""

    ends: np.ndarray
    faces: np.ndarray

    @classmethod
    def of(cls, faces: np.ndarray, kept: np.ndarray, count: int) -> _Cuts:
        """Of ``faces`` (F, 3) that have vertices of both kinds, ``kept`` (V,) bool, V = ``count``.

        Each is turned so that the vertex that is alone in being kept or not comes first.
        """
        here = kept[faces]
        alone = here == (here.sum(1, keepdims=True) == 1)
        turn = (alone.argmax(1)[:, None] + np.arange(3)) % 3
        first, second, third = np.take_along_axis(faces, turn, 1).T
        single = kept[first]
        pairs = np.stack([[first, second], [first, third]], 0)
        pairs = np.where(single, pairs, pairs[:, ::-1])
        keys = pairs[:, 0].astype(np.int64) * count + pairs[:, 1]
        edges, edge = np.unique(keys, return_inverse=True)
        after, before = edge.reshape(keys.shape) + count
        corner = np.stack([first, after, before], 1)[single]
        quads = [
            np.stack(each, 1)[~single] for each in ((after, second, third), (after, third, before))
        ]
        return cls(np.stack(np.divmod(edges, count), 1), np.concatenate([corner, *quads]))
