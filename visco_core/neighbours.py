"""Nearest neighbours in large scans, in pieces between which a stop request is asked for."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from visco_core.progress import Check, attend, never

PIECE = 2**14
"""How many places are looked up between two such questions: about a tenth of a second's work."""


class Neighbours:
    """The points (P, 3) that are looked among.

    ``threads`` may look at once, -1 for as many as there are cores; ``check`` raises Stopped.
    """

    def __init__(self, points: np.ndarray, threads: int = -1, check: Check = never) -> None:
        self._threads, self._check = threads, check
        # Half the time to build, and answers as fast as a balanced tree.
        self._tree = attend(lambda: KDTree(points, balanced_tree=False, compact_nodes=False), check)

    def nearest(
        self, places: np.ndarray, count: int = 1, within: float = np.inf
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances and indices (Q, count) of the points nearest to ``places`` (Q, 3), in order.

        A distance is infinite where there is no further point, or none nearer than ``within``.
        """
        distance, index = np.empty((len(places), count)), np.empty((len(places), count), np.int64)
        for start in range(0, len(places), PIECE):
            self._check()
            part = slice(start, start + PIECE)
            distance[part], index[part] = self._tree.query(
                places[part],
                list(range(1, count + 1)),  # type: ignore[arg-type]
                distance_upper_bound=within,
                workers=self._threads,
            )
        return distance, index
