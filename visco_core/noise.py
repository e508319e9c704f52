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

from visco_core.bending import Scale, bending, scales
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never
from visco_core.quadrics import (
    MEDIAN_SQUARE,
    NEIGHBOURS,
    SAMPLES,
    Quadrics,
    deviation,
    fit,
)

CLOSEST = 0.02
"""Share of the pairs of neighbours that tell the noise; those up to twice as far apart tell how
much of their difference the distance makes."""

WIDE, NARROWED = 3.0, 4.4
"""Deviations of the noise that the radius of a neighbourhood must have: below, the nearest points
are those that noise has brought near. That takes (1 + NARROWED σ²/radius²) off the noise, as planes
of points show whose noise is known."""

HALVES_WIDE = 2.7
"""The same for what two halves tell of it."""

THINNING, THINNEST = 4, 300
"""One point in so many is kept for wider neighbourhoods, and how many must be left."""

ROUNDING = 1e-6
"""Noise below this share of the scan's extent is that of its coordinates' digits."""

OTHER_WALL = 0.25
"""Share of neighbourhoods' points that face the other way where walls come near."""

SAME_SHEET = 3.0
"""Deviations from the fit within which a normal that faces the other way is a wrong one, and not
that of another wall."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations along the surface normal, in units of the points, and of the normals.

    ``bending`` is by how much quadrics over the asked radius miss the surface at their middle, root
    mean square, in units of the points; ``wall`` the radius of neighbourhoods that other walls
    reach into, infinite if none do. ``spacing`` is how far apart neighbours would lie in an even
    scan as dense.
    """

    position: float
    normal: float
    bending: float
    wall: float
    spacing: float


def estimate_noise(
    points: np.ndarray,
    normals: np.ndarray,
    reach: float,
    seed: int = 0,
    threads: int = -1,
    check: Check = never,
) -> Noise:
    """The noise of ``points`` (P, 3) and of their unit normals (P, 3), and how the surface bends.

    ``reach`` is the radius of the bending, in units of the points. The deviation of the normals is
    measured about their own linear trend among the nearest neighbours, so noise that neighbours
    share is not seen.
    """
    random = np.random.default_rng(seed)
    nearest = sheets = _look(points, normals, random, threads, check)
    if len(points) <= NEIGHBOURS:
        # One neighbourhood is the whole scan: what a quadric leaves over may well be its shape.
        return Noise(0.0, nearest.tilt, 0.0, math.inf, 0.0)
    seen = list(scales(points, normals, random, threads, check))
    kept = points, normals
    while sheets.radius < WIDE * sheets.noise and len(kept[0]) >= THINNING * THINNEST:
        chosen = random.random(len(kept[0])) < 1 / THINNING
        kept = kept[0][chosen], kept[1][chosen]
        sheets = _look(*kept, random, threads, check)
    told = (each.noise for each in seen if each.radius >= HALVES_WIDE * sheets.noise)
    position = min(sheets.noise, next(told, math.inf))
    if position <= ROUNDING * float(np.ptp(points, axis=0).max()):
        position = 0.0
    bent = bending(reach, seen, position)
    if bent is None:
        # Too few points for halves: what quadrics leave over, over wherever they reach, stands in.
        bent = nearest.residual
    spacing = nearest.radius * math.sqrt(math.pi / NEIGHBOURS)
    return Noise(position, nearest.tilt, bent, _wall(seen, position), spacing)


def _wall(seen: list[Scale], noise: float) -> float:
    wide = (each for each in seen if each.radius > WIDE * noise)
    return next((each.radius for each in wide if each.other_wall > OTHER_WALL), math.inf)


@dataclass(frozen=True)
class _Sheets:
    """Of neighbourhoods the median radius, what quadrics leave over, squared and averaged so that
    creases count, the noise in it, and the median scatter of the normals."""

    radius: float
    residual: float
    noise: float
    tilt: float


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
    quadrics = Quadrics.through(points[nearest], side)
    apart, basis = quadrics.residual[..., None], quadrics.basis
    scatter = deviation(apart, side, basis.shape[2])
    sheet = side | (np.abs(apart[..., 0]) <= SAME_SHEET * scatter[:, None])
    trend = basis[..., :3]
    turned = normals[nearest] - trend @ fit(normals[nearest], trend, sheet)
    tilt = float(np.median(deviation(turned, sheet, trend.shape[2])))
    residual = float(np.sqrt(np.square(scatter).mean()))
    upright = apart[..., 0] / np.sqrt(1 + quadrics.squared_slope)
    nugget = _nugget(upright, basis[..., 1:3], side)
    # The closest pairs may all lie where several scans overlap, which is not the whole surface.
    noise = min(nugget, float(np.median(scatter)))
    radius = max(float(np.median(away[:, -1])), np.finfo(float).tiny)
    noise *= 1 + NARROWED * (noise / radius) ** 2
    return _Sheets(radius, residual, noise, tilt)


def _side(normals: np.ndarray) -> np.ndarray:
    """(S, K) bool: which of the unit normals (S, K, 3) face the way that most of a sample's do."""
    facing = np.einsum("ski,si->sk", normals, normals[:, 0]) > 0
    return facing == (facing.mean(1, keepdims=True) >= 0.5)


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
