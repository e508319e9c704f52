"""Normals where the scan has none: planes through neighbours, turned outward."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.orientation import outward_signs
from visco_core.progress import Check, never

SIZES = ((16, 1.0), (8, 0.5))
"""Neighbours that show a plane, and how much flatter than the first so many must look to be taken:
fewer are, between close walls and beside edges."""

THINNING = (1, 3, 9, 27, 81)
"""Neighbours are looked for among every point, or one in so many where the noise is coarser."""

FLAT = 0.57
"""Thickness over width of a typical neighbourhood of 16 that still shows its plane."""

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
    points, _ = _framed(points)
    thinned = _thinned(points, threads, check)
    directions = _directions(points, points, thinned[-1], check)
    signs = _outward(points, directions, thinned, threads, check)
    return (directions * signs[:, None]).astype(np.float32)


def outward_sides(
    points: np.ndarray, directions: np.ndarray, threads: int = -1, check: Check = never
) -> np.ndarray:
    """(P,) ±1 that turn the unit ``directions`` (P, 3) at ``points`` (P, 3) outward."""
    points, _ = _framed(points)
    return _outward(points, directions, _thinned(points, threads, check), threads, check)


def _outward(
    points: np.ndarray,
    directions: np.ndarray,
    thinned: list[tuple[np.ndarray, Neighbours]],
    threads: int,
    check: Check,
) -> np.ndarray:
    chosen, neighbours = thinned[max(len(thinned) - 1 - LINKS_THINNED, 0)]
    return outward_signs(points, directions, chosen, neighbours, threads, check)


def plane_finder(
    points: np.ndarray, threads: int = -1, check: Check = never
) -> Callable[[np.ndarray], np.ndarray]:
    """What gives for places (Q, 3) the unit normals (Q, 3), of either sign, of the planes there.

    The planes are those through the nearest of ``points`` (P, 3).
    """
    framed, into_frame = _framed(points)
    widest = _thinned(framed, threads, check)[-1]
    return lambda places: _directions(framed, into_frame(places), widest, check)


def _framed(points: np.ndarray) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """``points`` (P, 3) around the origin, their longest side 1, and what moves others there."""
    middle, side = points.mean(0), np.ptp(points, axis=0).max()

    def into_frame(places: np.ndarray) -> np.ndarray:
        return (places - middle) / side

    return into_frame(points), into_frame


def _directions(
    points: np.ndarray, places: np.ndarray, among: tuple[np.ndarray, Neighbours], check: Check
) -> np.ndarray:
    """Unit normals (Q, 3), of either sign, at ``places`` (Q, 3), in pieces."""
    directions = np.empty_like(places)
    for start in range(0, len(places), PIECE):
        check()
        part = slice(start, start + PIECE)
        directions[part] = _planes(points, places[part], *among)[0]
    return directions


def _thinned(points: np.ndarray, threads: int, check: Check) -> list[tuple[np.ndarray, Neighbours]]:
    """Indices of ever fewer points, and a tree of each, up to those that show planes best.

    Where the noise is coarser than the distance between points, a plane through the nearest ones
    has any direction. Between walls as close as the points fewer points may show it worse, so those
    are taken that leave the tenth that shows it worst best.
    """
    shuffled = np.random.default_rng(0).permutation(len(points))
    probes = points[shuffled[:PROBES]]
    found, worst = [], []
    for thinning in THINNING:
        chosen = np.sort(shuffled[: max(len(points) // thinning, 1)])
        among = chosen, Neighbours(points[chosen], threads, check)
        found.append(among)
        worst.append(np.quantile(_flatness(_planes(points, probes, *among)[1]), 0.9))
        plain = _flatness(_planes(points, probes, *among, sizes=SIZES[:1])[1])
        if np.median(plain) < FLAT or len(points) < FEWEST * 3 * thinning:
            break
    return found[: int(np.argmin(worst)) + 1]


def _flatness(deviations: np.ndarray) -> np.ndarray:
    """Thickness over width (Q,) of neighbourhoods with ``deviations`` (Q, 3), ascending."""
    return deviations[:, 0] / np.maximum(deviations[:, 1], 1e-300)


def _planes(
    points: np.ndarray,
    places: np.ndarray,
    chosen: np.ndarray,
    neighbours: Neighbours,
    sizes: tuple[tuple[int, float], ...] = SIZES,
) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (Q, 3), of either sign, of the planes at ``places`` (Q, 3), and deviations.

    The deviations (Q, 3) are those of the neighbours along their principal axes, ascending.
    """
    most = min(max(count for count, _ in sizes), len(chosen))
    away = points[chosen[neighbours.nearest(places, most)[1].T]] - places
    # Contiguous along the places: several times as fast as a product for each.
    away = [np.ascontiguousarray(axis) for axis in np.moveaxis(away, 2, 0)]
    covariance = np.empty((len(places), 3, 3))
    flattest = np.full(len(places), np.inf)
    for count, gain in sizes:
        other = _covariance([axis[:count] for axis in away])
        flatness = _squared_flatness(other, min(count, most)) / gain**2
        better = flatness < flattest
        covariance[better], flattest[better] = other[better], flatness[better]
    squared, axes = np.linalg.eigh(covariance)
    return axes[:, :, 0], np.sqrt(np.maximum(squared, 0))


def _covariance(offsets: list[np.ndarray]) -> np.ndarray:
    """(Q, 3, 3) of K neighbours each, whose x, y and z offsets (K, Q) are given."""
    away = [axis - axis.mean(0) for axis in offsets]
    count, places = away[0].shape
    covariance = np.empty((places, 3, 3))
    for row in range(3):
        for column in range(row + 1):
            product = np.einsum("kq,kq->q", away[row], away[column]) / count
            covariance[:, row, column] = covariance[:, column, row] = product
    return covariance


def _squared_flatness(covariance: np.ndarray, count: int) -> np.ndarray:
    """(Q,): squared thickness over width of neighbourhoods of ``count``; covariance (Q, 3, 3).

    Without the axes: det / minors^1.5. The plane took three of the neighbours' freedoms.
    """
    xx, yy, zz = (covariance[:, axis, axis] for axis in range(3))
    yx, zx, zy = covariance[:, 1, 0], covariance[:, 2, 0], covariance[:, 2, 1]
    minors = xx * yy - yx**2 + xx * zz - zx**2 + yy * zz - zy**2
    determinant = xx * (yy * zz - zy**2) - yx * (yx * zz - zy * zx) + zx * (yx * zy - yy * zx)
    thin = np.maximum(determinant, 0) / np.maximum(minors, 1e-300) ** 1.5
    return thin * count / max(count - 3, 1)
