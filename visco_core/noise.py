"""How noisy a scan is, read off the scan itself: it decides how much smoothing the solve applies.

Around sampled points a quadric is fitted through the k nearest neighbours, and its residual is
measured for growing k. It holds the noise, and what the quadric cannot follow, which grows with k;
two sizes tell the two apart. Where the neighbourhood is thinner than the noise the fit follows the
noise too, so the largest answer of all sizes is taken. Of small neighbourhoods only the side that
most normals face is fitted: through both faces of a thin wall the thickness would pass for noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

SCALES = ((24, 800), (96, 400), (384, 200), (1536, 100))
"""Neighbours, and how many points are sampled at that size."""

ONE_SIDED = 96
"""Neighbours up to which one side is fitted. The larger sizes tell only of noise so coarse that
normals hardly know their side, and the smoothing was calibrated on what they say of both."""

SAME_SHEET = 3.0
"""Deviations from the fit within which a normal that faces the other way is a wrong one, and not
that of another wall."""

CURVATURE_GROWTH = 3.3
"""How much more a quadric leaves over of an exact surface when k grows fourfold."""

CURVATURE = 2.5
"""Growth of the residual after which no larger scale can tell more."""

FLAT = 1.5
"""Growth below which the largest scale holds little but noise."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations along the surface normal, in units of the points, and of the normals."""

    position: float
    normal: float


def estimate_noise(
    points: np.ndarray,
    normals: np.ndarray,
    seed: int = 0,
    threads: int = -1,
    check: Check = never,
) -> Noise:
    """The noise of ``points`` (P, 3) and of their unit normals (P, 3).

    The deviation of the normals is measured about their own linear trend at the smallest scale, so
    noise that neighbours share is not seen.
    """
    random = np.random.default_rng(seed)
    around = Neighbours(points, threads, check)
    residuals: list[float] = []
    normal_deviation = 0.0
    for neighbours, samples in SCALES:
        count = min(neighbours, len(points))
        chosen = random.choice(len(points), min(samples, len(points)), replace=False)
        nearest = around.nearest(points[chosen], count)[1]
        side = _side(normals[nearest]) if count <= ONE_SIDED else np.ones(nearest.shape, bool)
        basis, height = _local_frame(points[nearest], side)
        apart = _residual(height[..., None], basis, side)
        deviation = _deviation(apart, side, basis.shape[2])
        residuals.append(float(np.median(deviation)))
        if len(residuals) == 1:
            sheet = side | (np.abs(apart[..., 0]) <= SAME_SHEET * deviation[:, None])
            trend = basis[..., :3]
            tilt = _deviation(_residual(normals[nearest], trend, sheet), sheet, trend.shape[2])
            normal_deviation = float(np.median(tilt))
        elif residuals[-1] > CURVATURE * residuals[-2]:
            break
    return Noise(_without_curvature(np.array(residuals)), normal_deviation)


def _side(normals: np.ndarray) -> np.ndarray:
    """(S, K) bool: which of the unit normals (S, K, 3) face the way that most of a sample's do."""
    facing = np.einsum("ski,si->sk", normals, normals[:, 0]) > 0
    return facing == (facing.mean(1, keepdims=True) >= 0.5)


def _local_frame(around: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic basis (S, K, 6) over, and height (S, K) above, the plane through those ``kept``."""
    share = kept / kept.sum(1, keepdims=True)
    centered = around - np.einsum("sk,ski->si", share, around)[:, None]
    weighted = centered * share[..., None]
    variance, axes = np.linalg.eigh(np.einsum("ski,skj->sij", weighted, centered))
    height, x, y = np.moveaxis(np.einsum("ski,sij->skj", centered, axes), -1, 0)
    extent = np.sqrt(np.maximum(variance[:, 2:], np.finfo(float).tiny))
    x, y = x / extent, y / extent
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1), height


def _residual(values: np.ndarray, basis: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """``values`` (S, K, D) less what ``basis`` (S, K, B) fits to those ``kept`` (S, K)."""
    terms, count = basis.shape[2], kept.sum(1)
    fitted = basis * kept[..., None]
    square = np.einsum("ska,skb->sab", fitted, basis)
    square += 1e-9 * count[:, None, None] * np.eye(terms)
    fit = np.linalg.solve(square, np.einsum("ska,skd->sad", fitted, values))
    return values - np.einsum("ska,sad->skd", basis, fit)


def _deviation(residual: np.ndarray, kept: np.ndarray, terms: int) -> np.ndarray:
    """Standard deviation (S,) of the residuals (S, K, D) ``kept`` of a fit with so many terms."""
    square = (np.square(residual).sum(2) * kept).sum(1)
    return np.sqrt(square / np.maximum(kept.sum(1) - terms, 1))


def _without_curvature(residuals: np.ndarray) -> float:
    """The noise σ in residuals (S,) of growing scales: r_s² = σ² + c², where c grows by the scale.

    c is CURVATURE_GROWTH times larger on the next scale, until scales outgrow the surface's detail;
    so none is asked beyond those between which the residual grows least.
    """
    square, factor = np.square(residuals), CURVATURE_GROWTH**2
    noise = (square[:-1] - square[1:] / factor) / (1 - 1 / factor)
    growth = residuals[1:] / np.maximum(residuals[:-1], np.finfo(float).tiny)
    slowest = int(growth.argmin())
    asked = noise[: slowest + 1]
    if slowest + 1 == len(growth) and growth[-1] < FLAT:
        asked = np.append(asked, square[-1])
    # Where curvature hides the noise at every scale, half of the smallest residual is a fair guess.
    return float(np.sqrt(asked.max(initial=square[0] / 4)))
