"""How noisy a scan is, read off the scan itself: it decides how much smoothing the solve applies.

Around sampled points a quadric is fitted through the nearest neighbours. What it leaves over holds
the noise, and the detail that the quadric cannot follow; the closer together two points lie, the
less of the latter their residuals differ by, and what is left for two at the same place is noise:
the nugget of the residuals' variogram (Matheron, 1963). A neighbourhood no wider than the noise is
a ball of points rather than a sheet, so the scan is thinned until it is wide enough. Of each only
the side that most normals face is used: between both faces of a thin wall the thickness would pass
for noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

NEIGHBOURS, SAMPLES = 24, 800
"""Points of a neighbourhood, and how many neighbourhoods are looked at."""

CLOSEST = 0.02
"""Share of the pairs of neighbours that tell the noise; those up to twice as far apart tell how
much of their difference the distance makes."""

WIDE, NARROWED = 3.0, 4.4
"""Deviations of the noise that the radius of a neighbourhood must have: below, the nearest points
are those that noise has brought near. That takes (1 + NARROWED σ²/radius²) off the noise, as planes
of points show whose noise is known."""

THINNING, THINNEST = 4, 300
"""One point in so many is kept for wider neighbourhoods, and how many must be left."""

OTHER_WALL, BEYOND_WALLS = 0.25, 2.0
"""Share of a neighbourhood on another wall from which on the wall is the detail that must not be
lost, and how many of the neighbourhood's radii it is taken for."""

ROUNDING = 1e-6
"""Noise below this share of the scan's extent is that of its coordinates' digits."""

SAME_SHEET = 3.0
"""Deviations from the fit within which a normal that faces the other way is a wrong one, and not
that of another wall."""

MEDIAN_SQUARE = 0.4549
"""Median of the square of a normal deviate."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations along the surface normal, in units of the points, and of the normals.

    ``detail`` is the radius, in units of the points, of neighbourhoods in which the shape departs
    from a quadric by as much as the noise: finer detail is lost in it. ``spacing`` is how far apart
    neighbours would lie in an even scan as dense.
    """

    position: float
    normal: float
    detail: float
    spacing: float


def estimate_noise(
    points: np.ndarray,
    normals: np.ndarray,
    seed: int = 0,
    threads: int = -1,
    check: Check = never,
) -> Noise:
    """The noise of ``points`` (P, 3) and of their unit normals (P, 3).

    The deviation of the normals is measured about their own linear trend among the nearest
    neighbours, so noise that neighbours share is not seen.
    """
    random = np.random.default_rng(seed)
    least = ROUNDING * float(np.ptp(points, axis=0).max())
    nearest = sheets = _look(points, normals, random, threads, check)
    if len(points) <= NEIGHBOURS:
        # One neighbourhood is the whole scan: what a quadric leaves over may well be its shape.
        return Noise(0.0, nearest.tilt, 0.0, 0.0)
    position = None
    while True:
        if position is None and sheets.radius >= WIDE * sheets.noise:
            position = sheets.noise if sheets.noise > least else 0.0
        if position is not None and (sheets.residual**2 >= 2 * position**2 or sheets.two_walls):
            break
        if len(points) < THINNING * THINNEST:
            break
        kept = random.random(len(points)) < 1 / THINNING
        points, normals = points[kept], normals[kept]
        sheets = _look(points, normals, random, threads, check)
    position = sheets.noise if position is None else position
    detail = sheets.radius
    if sheets.two_walls and sheets.residual**2 < 2 * position**2:
        detail *= BEYOND_WALLS
    apart = math.sqrt(max(sheets.residual**2 - position**2, position**2))
    if apart:
        # What a quadric cannot follow grows with the cube of the radius; below the nearest
        # neighbours it is not seen, and noise that is so much less than it might be none.
        detail *= (position / apart) ** (1 if sheets is nearest else 1 / 3)
    spacing = nearest.radius * math.sqrt(math.pi / NEIGHBOURS)
    return Noise(position, nearest.tilt, detail if position else 0.0, spacing)


@dataclass(frozen=True)
class _Sheets:
    """Of neighbourhoods the median radius, what quadrics leave over, squared and averaged so that
    creases count, the noise in it, the median scatter of the normals, and whether most hold the
    other face of a wall too."""

    radius: float
    residual: float
    noise: float
    tilt: float
    two_walls: bool


def _look(
    points: np.ndarray,
    normals: np.ndarray,
    random: np.random.Generator,
    threads: int,
    check: Check,
) -> _Sheets:
    chosen = random.choice(len(points), min(SAMPLES, len(points)), replace=False)
    count = min(NEIGHBOURS, len(points))
    away, nearest = Neighbours(points, threads, check).nearest(points[chosen], count)
    check()
    side = _side(normals[nearest])
    basis, height, extent = _local_frame(points[nearest], side)
    quadric = _fit(height[..., None], basis, side)
    apart = height[..., None] - basis @ quadric
    deviation = _deviation(apart, side, basis.shape[2])
    sheet = side | (np.abs(apart[..., 0]) <= SAME_SHEET * deviation[:, None])
    trend = basis[..., :3]
    turned = normals[nearest] - trend @ _fit(normals[nearest], trend, sheet)
    tilt = float(np.median(_deviation(turned, sheet, trend.shape[2])))
    residual = float(np.sqrt(np.square(deviation).mean()))
    upright = apart[..., 0] / np.sqrt(1 + _squared_slope(quadric[..., 0], basis, extent))
    nugget = _nugget(upright, basis[..., 1:3], side)
    # The closest pairs may all lie where several scans overlap, which is not the whole surface.
    noise = min(nugget, float(np.median(deviation)))
    radius = max(float(np.median(away[:, -1])), np.finfo(float).tiny)
    noise *= 1 + NARROWED * (noise / radius) ** 2
    two_walls = bool(np.median((~sheet).mean(1)) > OTHER_WALL)
    return _Sheets(radius, residual, noise, tilt, two_walls)


def _side(normals: np.ndarray) -> np.ndarray:
    """(S, K) bool: which of the unit normals (S, K, 3) face the way that most of a sample's do."""
    facing = np.einsum("ski,si->sk", normals, normals[:, 0]) > 0
    return facing == (facing.mean(1, keepdims=True) >= 0.5)


def _local_frame(around: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadratic basis (S, K, 6) over, and height (S, K) above, the plane through those ``kept``.

    The basis is of coordinates in units of the neighbourhood's extent (S, 1).
    """
    share = kept / kept.sum(1, keepdims=True)
    centered = around - np.einsum("sk,ski->si", share, around)[:, None]
    weighted = centered * share[..., None]
    variance, axes = np.linalg.eigh(np.einsum("ski,skj->sij", weighted, centered))
    height, x, y = np.moveaxis(np.einsum("ski,sij->skj", centered, axes), -1, 0)
    extent = np.sqrt(np.maximum(variance[:, 2:], np.finfo(float).tiny))
    x, y = x / extent, y / extent
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1), height, extent


def _fit(values: np.ndarray, basis: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """The coefficients (S, B, D) with which ``basis`` (S, K, B) fits ``values`` (S, K, D) best.

    Only at the points ``kept`` (S, K).
    """
    terms, count = basis.shape[2], kept.sum(1)
    fitted = basis * kept[..., None]
    square = np.einsum("ska,skb->sab", fitted, basis)
    square += 1e-9 * count[:, None, None] * np.eye(terms)
    return np.linalg.solve(square, np.einsum("ska,skd->sad", fitted, values))


def _squared_slope(quadric: np.ndarray, basis: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """The square of the slope (S, K) of ``quadric`` (S, 6) against its plane.

    Noise is read across the surface, not the plane: where the surface is steep, noise along it
    passes for height too.
    """
    x, y = basis[..., 1], basis[..., 2]
    _, a, b, c, d, e = quadric.T[..., None]
    return (np.square(a + 2 * c * x + d * y) + np.square(b + d * x + 2 * e * y)) / extent**2


def _deviation(residual: np.ndarray, kept: np.ndarray, terms: int) -> np.ndarray:
    """Standard deviation (S,) of the residuals (S, K, D) ``kept`` of a fit with so many terms."""
    square = (np.square(residual).sum(2) * kept).sum(1)
    return np.sqrt(square / np.maximum(kept.sum(1) - terms, 1))


def _nugget(residual: np.ndarray, places: np.ndarray, kept: np.ndarray) -> float:
    """The noise σ in residuals (S, K) of points at ``places`` (S, K, 2) in their plane.

    Two points t apart differ by 2σ² + b t², squared: by the noise of both, and by the slope of what
    the fit has not followed. Medians, since near a crease or another sheet they differ by more.
    Points at the same place are copies, and tell nothing.
    """
    one, other = np.triu_indices(residual.shape[1], 1)
    apart = np.square(places[:, one] - places[:, other]).sum(2)
    apart[~(kept[:, one] & kept[:, other])] = 0
    told = apart > 0
    apart, differ = apart[told], np.square(residual[:, one] - residual[:, other])[told]
    if not len(apart):
        return 0.0
    reach = np.quantile(apart, CLOSEST)
    close, further = apart <= reach, (apart > reach) & (apart <= 4 * reach)
    nugget = np.median(differ[close])
    if further.any():
        ratio = apart[close].mean() / apart[further].mean()
        nugget = (nugget - ratio * np.median(differ[further])) / (1 - ratio)
    return float(np.sqrt(max(nugget, 0) / (2 * MEDIAN_SQUARE)))
