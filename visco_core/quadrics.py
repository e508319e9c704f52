"""Quadrics through neighbourhoods of points, on one side of thin walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEIGHBOURS, SAMPLES = 24, 800
"""Points of a neighbourhood, and how many neighbourhoods are looked at."""

MEDIAN_SQUARE = 0.4549
"""Median of the square of a normal deviate."""


@dataclass(frozen=True)
class Quadrics:
    """Heights over the plane of each of S neighbourhoods of K points, fitted by least squares.

    kept (S, K) bool: the points that are fitted; middle (S, 3) of these; axes (S, 3, 3): columns
    are the plane's normal and its two directions; extent (S, 1): of the neighbourhood, the unit of
    the coordinates in the plane; basis (S, K, 6): 1, x, y, x², xy, y² of the points; height (S, K);
    square (S, 6, 6): the normal matrices; coefficients (S, 6).
    """

    kept: np.ndarray
    middle: np.ndarray
    axes: np.ndarray
    extent: np.ndarray
    basis: np.ndarray
    height: np.ndarray
    square: np.ndarray
    coefficients: np.ndarray

    @classmethod
    def through(cls, around: np.ndarray, kept: np.ndarray) -> Quadrics:
        """Those through the points ``around`` (S, K, 3) that are ``kept`` (S, K), at least one."""
        share = kept / kept.sum(1, keepdims=True)
        middle = (share[:, None] @ around)[:, 0]
        centered = around - middle[:, None]
        weighted = centered * share[..., None]
        variance, axes = np.linalg.eigh(np.swapaxes(weighted, 1, 2) @ centered)
        height, x, y = np.moveaxis(centered @ axes, -1, 0)
        extent = np.sqrt(np.maximum(variance[:, 2:], np.finfo(float).tiny))
        basis = quadratic_terms(x / extent, y / extent)
        square, wanted = _normal_equations(height[..., None], basis, kept)
        coefficients = np.linalg.solve(square, wanted)[..., 0]
        return cls(kept, middle, axes, extent, basis, height, square, coefficients)

    @property
    def residual(self) -> np.ndarray:
        """(S, K): how far the points lie above the quadric, along the plane's normal."""
        return self.height - (self.basis @ self.coefficients[..., None])[..., 0]

    @property
    def squared_slope(self) -> np.ndarray:
        """(S, K): the square of the quadric's slope against its plane, at the points.

        Noise is read across the surface, not the plane: where the surface is steep, noise along it
        passes for height too.
        """
        x, y = self.basis[..., 1], self.basis[..., 2]
        _, a, b, c, d, e = self.coefficients.T[..., None]
        along_x, along_y = a + 2 * c * x + d * y, b + d * x + 2 * e * y
        return (np.square(along_x) + np.square(along_y)) / self.extent**2

    def above(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far ``places`` (S, 3) lie above their quadric, and the variance of that (S,).

        The variance is what noise of variance 1 in the points along each axis makes of the quadric.
        """
        height, x, y = np.einsum("si,sij->js", places - self.middle, self.axes)
        there = quadratic_terms(x / self.extent[:, 0], y / self.extent[:, 0])
        weight = (self.basis @ np.linalg.solve(self.square, there[..., None]))[..., 0] * self.kept
        variance = (np.square(weight) * (1 + self.squared_slope)).sum(1)
        return height - (there * self.coefficients).sum(1), variance


def fit(values: np.ndarray, basis: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """The coefficients (S, B, D) with which ``basis`` (S, K, B) fits ``values`` (S, K, D) best.

    Only at the points ``kept`` (S, K), or with these as weights.
    """
    return np.linalg.solve(*_normal_equations(values, basis, kept))


def deviation(residual: np.ndarray, kept: np.ndarray, terms: int) -> np.ndarray:
    """Standard deviation (S,) of the residuals (S, K, D) ``kept`` of a fit with so many terms."""
    square = (np.square(residual).sum(2) * kept).sum(1)
    return np.sqrt(square / np.maximum(kept.sum(1) - terms, 1))


def _normal_equations(
    values: np.ndarray, basis: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (S, B, B), regular where points are few or in a row, and right sides (S, B, D)."""
    fitted = np.swapaxes(basis * kept[..., None], 1, 2)
    square = fitted @ basis + 1e-9 * kept.sum(1)[:, None, None] * np.eye(basis.shape[2])
    return square, fitted @ values


def quadratic_terms(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The basis (..., 6) of a quadric at x, y (...) of its plane."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
