"""Nearest neighbours in large scans, in pieces between which a stop request is asked for."""

from __future__ import annotations

import math
import os

import numpy as np

from visco_core.kernels.native import library, set_threads
from visco_core.progress import Check, attend, never

PIECE = 2**14
"""How many places are looked up between two such questions: about a tenth of a second's work."""

LEAF = 12
"""Points that a leaf of the tree holds at most."""


class Neighbours:
    """The points (P, 3) that are looked among.

    ``threads`` may look at once, -1 for as many as there are cores; ``check`` raises Stopped.
    """

    def __init__(self, points: np.ndarray, threads: int = -1, check: Check = never) -> None:
        self._threads = os.cpu_count() or 1 if threads == -1 else threads
        self._check = check
        points, count = np.ascontiguousarray(points, np.float64), len(points)
        depth = max(math.ceil(math.log2(max(count, 1) / LEAF)), 0)
        order, inner = np.empty(count, np.int64), 2**depth - 1
        sorted_points, splits, axes = (
            np.empty((count, 3)),
            np.empty(inner),
            np.empty(inner, np.uint8),
        )
        tree = order, sorted_points, splits, axes
        attend(lambda: self._run(library.tree_build, points, count, depth, *tree), check)
        self._tree = sorted_points, order, count, depth, splits, axes

    def nearest(
        self, places: np.ndarray, count: int = 1, within: float = np.inf
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances and indices (Q, count) of the points nearest to ``places`` (Q, 3), in order.

        A distance is infinite, and the index P, where there is no further point, or none nearer
        than ``within``.
        """
        distance, index = np.empty((len(places), count)), np.empty((len(places), count), np.int64)
        for start in range(0, len(places), PIECE):
            self._check()
            part = slice(start, start + PIECE)
            piece = np.ascontiguousarray(places[part], np.float64)
            wanted = piece, len(piece), count, within, distance[part], index[part]
            self._run(library.tree_nearest, *self._tree, *wanted)
        return distance, index

    def _run(self, function, *arguments) -> None:
        before = set_threads(self._threads)
        try:
            function(*arguments)
        finally:
            set_threads(before)
