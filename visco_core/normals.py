"""Normals where the scan has none: planes through neighbours, turned outward."""

from __future__ import annotations

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.orientation import outward_signs
from visco_core.progress import Check, never

NEIGHBOURS = 16

THINNING = (1, 3, 9, 27, 81)
"""Neighbours are looked for among every point, or one in so many where the noise is coarser."""

FLAT = 0.57
"""Thickness over width of a typical neighbourhood that still shows its plane."""

FEWEST = 500
"""No thinning leaves fewer points than this."""

LINKS_THINNED = 2
"""Neighbours for the sides are so many thinnings closer than those for the directions."""

PROBES = 2000
"""Neighbourhoods that are looked at to find the thinning."""

PIECE = 2**14
"""How many points are worked on between two questions whether to stop."""


def estimate_normals(points: np.ndarray, threads: int = -1, check: Check = never) -> np.ndarray:
    """Unit outward normals (P, 3) float32 of ``points`` (P, 3).

    On an open sheet, which has no inside, all lie on one side.
    """
    points = points - points.mean(0)
    points /= np.ptp(points, axis=0).max()
    thinned = _thinned(points, threads, check)
    directions = np.empty_like(points)
    for start in range(0, len(points), PIECE):
        check()
        part = slice(start, start + PIECE)
        directions[part] = _planes(points, points[part], *thinned[-1])[0]
    chosen, neighbours = thinned[max(len(thinned) - 1 - LINKS_THINNED, 0)]
    signs = outward_signs(points, directions, chosen, neighbours, threads, check)
    return (directions * signs[:, None]).astype(np.float32)


def _thinned(points: np.ndarray, threads: int, check: Check) -> list[tuple[np.ndarray, Neighbours]]:
    """Indices of ever fewer points, and a tree of each, until neighbourhoods are flat.

    Where the noise is coarser than the distance between points, a plane through the nearest ones
    has any direction.
    """
    shuffled = np.random.default_rng(0).permutation(len(points))
    probes = points[shuffled[:PROBES]]
    found = []
    for thinning in THINNING:
        chosen = np.sort(shuffled[: max(len(points) // thinning, 1)])
        found.append((chosen, Neighbours(points[chosen], threads, check)))
        deviation = _planes(points, probes, *found[-1])[1]
        flatness = np.median(deviation[:, 0] / np.maximum(deviation[:, 1], 1e-300))
        if flatness < FLAT or len(points) < FEWEST * 3 * thinning:
            break
    return found


def _planes(
    points: np.ndarray, places: np.ndarray, chosen: np.ndarray, neighbours: Neighbours
) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (Q, 3), of either sign, of the planes at ``places`` (Q, 3), and deviations.

    The deviations (Q, 3) are those of the neighbours along their principal axes, ascending.
    """
    nearest = neighbours.nearest(places, min(NEIGHBOURS, len(chosen)))[1]
    around = points[chosen[nearest.T]]
    # Contiguous along the places: several times as fast as a product for each.
    away = [np.ascontiguousarray(axis - axis.mean(0)) for axis in np.moveaxis(around, 2, 0)]
    covariance = np.zeros((len(places), 3, 3))
    for row in range(3):
        for column in range(row + 1):
            # eigh reads the lower triangle.
            covariance[:, row, column] = np.einsum("kq,kq->q", away[row], away[column])
    squared, axes = np.linalg.eigh(covariance / len(around))
    return axes[:, :, 0], np.sqrt(np.maximum(squared, 0))
