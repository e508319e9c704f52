"""How noisy a scan is, read off the scan itself: it decides how much smoothing the solve applies.

Around sampled points a quadric is fitted through the k nearest neighbours, and its residual is
measured for growing k. It holds the noise, and what the quadric cannot follow, which grows with k;
two sizes tell the two apart. Where the neighbourhood is thinner than the noise the fit follows the
noise too, so the largest answer of all sizes is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

SCALES = ((24, 800), (96, 400), (384, 200), (1536, 100))
"""Neighbours, and how many points are sampled at that size."""

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
        basis, height = _local_frame(points[nearest])
        residuals.append(_typical_deviation(height[..., None], basis))
        if len(residuals) == 1:
            normal_deviation = _typical_deviation(normals[nearest], basis[..., :3])
        elif residuals[-1] > CURVATURE * residuals[-2]:
            break
    return Noise(_without_curvature(np.array(residuals)), normal_deviation)


def _local_frame(around: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic basis (S, K, 6) over, and height (S, K) above, the plane through each sample."""
    centered = around - around.mean(1, keepdims=True)
    count = around.shape[1]
    variance, axes = np.linalg.eigh(np.einsum("ski,skj->sij", centered, centered) / count)
    height, x, y = np.moveaxis(np.einsum("ski,sij->skj", centered, axes), -1, 0)
    extent = np.sqrt(np.maximum(variance[:, 2:], np.finfo(float).tiny))
    x, y = x / extent, y / extent
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1), height


def _typical_deviation(values: np.ndarray, basis: np.ndarray) -> float:
    """Median over samples of how far ``values`` (S, K, D) lie from their fit in ``basis``."""
    count, terms = basis.shape[1:]
    square = np.einsum("ska,skb->sab", basis, basis) + 1e-9 * count * np.eye(terms)
    fit = np.linalg.solve(square, np.einsum("ska,skd->sad", basis, values))
    residual = np.square(values - np.einsum("ska,sad->skd", basis, fit)).sum((1, 2))
    return float(np.median(np.sqrt(residual / max(count - terms, 1))))


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
