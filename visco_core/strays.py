"""Points that lie on no surface: far strays, and what a scanner puts between surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from visco_core.box_sum import box_sum
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

_STRAY_SHARE, _STRAY_DISTANCE, _LEAST_POINTS_FOR_STRAYS = 0.01, 10.0, 20
_LEAST_BODY, _BODY_SHARE = 10, 1e-4
"""What ``find_strays`` says of far points, in its words."""

_LONELY, _FEWEST_LONELY, _MOSTLY_OFF = 0.15, 5, 0.9
"""Share of the usual number of points around that makes a place lonely, how many such places are
needed, and how many of them must be off the surface, for a scan to be looked through at all."""

_NEIGHBOURS, _FAR, _OFF_SURFACE = 12, 1.5, 0.3
"""Neighbours that say where the surface is, over the usual how far the last must be, and the sine
of the angle off its plane."""

_TOGETHER, _APART = 36, 16.0
"""Points among which one that is so many times closer to its own neighbours is on a surface, which
a group of fewer outliers is not."""

_ROUNDS = 10


def find_strays(points: np.ndarray) -> np.ndarray:
    """(P,) bool: far, lonely points that would only blow up the bounding box.

    points (P, 3), finite and distinct. Distances are largest coordinate differences. Let r be the
    distance from the median within which 99 % of the points lie (all but one, below 200). A point
    is a stray if it is farther than 10 r and has no body around it: points that far are put into
    cells of size r, and touching cells that together hold 10 of them, or 0.01 % of the scan if that
    is more, are a body and stay, however far away. Below 20 points nothing is a stray.
    """
    strays = np.zeros(len(points), bool)
    far, middle, radius = _far_away(points)
    if len(far):
        with np.errstate(over="ignore"):
            cells = np.floor(np.clip((points[far] - middle) / radius, -1e15, 1e15))
        sizes = _group_sizes(cells.astype(np.int64))
        strays[far] = sizes < max(_LEAST_BODY, _BODY_SHARE * len(points))
    return strays


def _far_away(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Indices of the points farther than 10 r from the median, the median (3,), and r."""
    count, middle = len(points), np.median(points, axis=0)
    none = np.empty(0, np.int64)
    if count < _LEAST_POINTS_FOR_STRAYS:
        return none, middle, 0.0
    with np.errstate(over="ignore"):
        distances = np.abs(points[:, 0] - middle[0])
        for axis in (1, 2):
            np.maximum(distances, np.abs(points[:, axis] - middle[axis]), out=distances)
    inner = count - 1 - max(1, int(_STRAY_SHARE * count))
    radius = float(np.partition(distances, inner)[inner])
    with np.errstate(over="ignore"):
        far = np.flatnonzero(distances > _STRAY_DISTANCE * radius)
    return (far if radius > 0 else none), middle, radius


def find_scattered(
    points: np.ndarray,
    normals: np.ndarray | None = None,
    threads: int = -1,
    check: Check = never,
) -> np.ndarray:
    """(P,) bool: points in the space between surfaces, where a scanner's noise has put them.

    points (P, 3), finite and distinct; normals (P, 3), unit, of either side, or None for those of
    planes through neighbours. A point is off the surface if half of its 12 nearest lie more than
    17° (sine 0.3) off its own plane, or it off theirs. Scans are left alone unless five points or
    more lie in lonely places, which coarse cells tell, and nine in ten of these are off the
    surface: elsewhere the scan is only sparse. (Once some are found, one lonely point is enough to
    go on.) Then all points go that are 1.5 times farther from their 12 nearest than is usual, and
    off, or 16 times farther than one of 36 nearest is from its own: fewer together are no surface.
    What has lost neighbours is looked at again while that finds more, up to ten times in all: among
    many such points some look like a surface until the others are gone.
    A body so far away that ``find_strays`` has judged it is left alone.
    """
    scattered = np.zeros(len(points), bool)
    bodies = _far_away(points)[0]
    reach, judged = np.zeros(len(points)), np.zeros(len(points), bool)
    changed = np.arange(len(points))
    for _ in range(_ROUNDS):
        kept = np.flatnonzero(~scattered)
        left = None if normals is None else normals[kept]
        look = _Look.at(points[kept], left, bool(scattered.any()), threads, check)
        if look is None:
            break
        reach[changed], judged[changed] = look.reach(points[changed]), False
        far = np.flatnonzero((reach[kept] > _FAR * np.median(reach[kept])) & ~judged[kept])
        judged[kept[far]] = True
        gone = kept[far[look.off_surface(far, reach[kept])]]
        gone = np.setdiff1d(gone, bodies)
        if not len(gone):
            break
        scattered[gone] = True
        # What has lost no neighbour looks the same the next time.
        kept = np.flatnonzero(~scattered)
        away = Neighbours(points[gone], threads, check).nearest(points[kept])[0][:, 0]
        changed = kept[away <= reach[kept]]
    return scattered


@dataclass(frozen=True)
class _Look:
    """One look at the points (P, 3) that are left."""

    points: np.ndarray
    look_up: Neighbours
    planes: Callable[[np.ndarray], np.ndarray]

    @classmethod
    def at(
        cls, points: np.ndarray, normals: np.ndarray | None, known: bool, threads: int, check: Check
    ) -> _Look | None:
        """None where there is nothing to find; ``known``: an earlier look has found something."""
        if len(points) <= _NEIGHBOURS:
            return None
        around = _count_around(points)
        lonely = np.flatnonzero(around < _LONELY * np.median(around))
        if len(lonely) < (1 if known else _FEWEST_LONELY):
            return None
        look_up = Neighbours(points, threads, check)
        look = cls(points, look_up, _planes(points, normals, threads, check))
        return look if known or look.off_surface(lonely).mean() > _MOSTLY_OFF else None

    def reach(self, places: np.ndarray) -> np.ndarray:
        """How far the last of 12 neighbours is from ``places`` (Q, 3), which are points."""
        return self.look_up.nearest(places, _NEIGHBOURS + 1)[0][:, -1]

    def off_surface(self, chosen: np.ndarray, reach: np.ndarray | None = None) -> np.ndarray:
        """Whether half of the neighbours of the points ``chosen`` (Q,) lie off their plane, or they
        off theirs, or one of 36 has a far smaller ``reach`` (P,), where that is given."""
        count = _NEIGHBOURS + 1 if reach is None else min(_TOGETHER, len(self.points))
        away, around = self.look_up.nearest(self.points[chosen], count)
        distance, near = away[:, 1 : _NEIGHBOURS + 1], around[:, 1 : _NEIGHBOURS + 1]
        offset = self.points[near] - self.points[chosen, None]
        both = self.planes(np.column_stack([near, chosen]))
        sines = [
            np.abs((offset * plane).sum(2)) / distance for plane in (both[:, :-1], both[:, -1:])
        ]
        off = np.max([np.median(sine, axis=1) for sine in sines], axis=0) > _OFF_SURFACE
        if reach is not None:
            off |= reach[around].min(1) < reach[chosen] / _APART
        return off


def _planes(
    points: np.ndarray, normals: np.ndarray | None, threads: int, check: Check
) -> Callable[[np.ndarray], np.ndarray]:
    """What gives the planes' normals (..., 3) of points by their indices, estimated if need be."""
    if normals is not None:
        return lambda indices: normals[indices]
    from visco_core.normals import plane_finder

    planes_at = plane_finder(points, threads, check)

    def estimated(indices: np.ndarray) -> np.ndarray:
        needed, place = np.unique(indices, return_inverse=True)
        return planes_at(points[needed])[place.reshape(indices.shape)]

    return estimated


def _count_around(points: np.ndarray) -> np.ndarray:
    """(P,) how many points share each one's cell and the 26 around it, some 60 on a surface."""
    cells = int(np.clip(np.sqrt(len(points) / 20), 4, 64))
    low = points.min(axis=0)
    width = np.ptp(points, axis=0).max() / cells
    cell = np.minimum(((points - low) / width).astype(np.int64), cells - 1)
    place = (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    counts = np.bincount(place, minlength=cells**3).reshape((cells,) * 3)
    return box_sum(counts, 3).ravel()[place]


def _group_sizes(cells: np.ndarray) -> np.ndarray:
    """(K,) for cells (K, 3): how many entries lie in the group of touching cells of each."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    distinct, cell = np.unique(cells, axis=0, return_inverse=True)
    tree = KDTree(distinct.astype(np.float64))
    touching = tree.sparse_distance_matrix(tree, 1.5, p=np.inf, output_type="coo_matrix")
    touching.data[:] = 1
    _, group = connected_components(touching, directed=False)
    group = group[cell.ravel()]
    return np.bincount(group)[group]
