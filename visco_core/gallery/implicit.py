"""Signed distances of simple solids and the ways to join them.

Every function maps points (P, 3) float64 to distances (P,), negative inside. Primitives are exact;
joins keep the Lipschitz constant at 1, so that a ray may always step by the value. Formulas are
Inigo Quilez's (iquilezles.org/articles/distfunctions).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def sphere(points: np.ndarray, center: ArrayLike, radius: float) -> np.ndarray:
    return _length(points - np.asarray(center)) - radius


def ellipsoid(points: np.ndarray, center: ArrayLike, radii: ArrayLike) -> np.ndarray:
    """Not exact: the sphere's distance after scaling, shrunk by the smallest radius."""
    scaled = (points - np.asarray(center)) / np.asarray(radii)
    return (_length(scaled) - 1.0) * np.min(radii)


def box(points: np.ndarray, center: ArrayLike, half: ArrayLike) -> np.ndarray:
    """A box with sharp edges and half extents ``half``."""
    outside = np.abs(points - np.asarray(center)) - np.asarray(half)
    return _corner(outside)


def torus(points: np.ndarray, major: float, minor: float) -> np.ndarray:
    """A torus around the z axis."""
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - major, points[:, 2]) - minor


def chain(points: np.ndarray, joints: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Rods with round ends from joint to joint (J, 3), tapering from radius to radius (J,).

    Shrunk by the steepest taper, and so exact only where nothing tapers.
    """
    axes, tapers = np.diff(joints, axis=0), np.diff(radii)
    squares = (axes**2).sum(axis=1)
    shrink = 1.0 / np.sqrt(1.0 + (tapers**2 / squares).max())
    starts = (joints[:-1] ** 2).sum(axis=1), (joints[:-1] * axes).sum(axis=1)
    distance = np.empty(len(points))
    # Pieces that stay in the processor's cache.
    for first in range(0, len(points), 2048):
        piece = points[first : first + 2048].T
        projected = axes @ piece - starts[1][:, None]
        along = np.clip(projected / squares[:, None], 0.0, 1.0)
        apart = starts[0][:, None] - 2.0 * joints[:-1] @ piece
        apart += along * (along * squares[:, None] - 2.0 * projected)
        apart += np.einsum("ij,ij->j", piece, piece)
        rods = np.sqrt(np.maximum(apart, 0.0)) - along * tapers[:, None]
        distance[first : first + 2048] = (rods - radii[:-1, None]).min(axis=0)
    return shrink * distance


def disc(plane_points: np.ndarray, center: ArrayLike, radius: float) -> np.ndarray:
    """Distance in the plane to a disc; ``plane_points`` (P, 2)."""
    return _length(plane_points - np.asarray(center)) - radius


def rectangle(plane_points: np.ndarray, center: ArrayLike, half: ArrayLike) -> np.ndarray:
    """Distance in the plane to a rectangle; ``plane_points`` (P, 2)."""
    return _corner(np.abs(plane_points - np.asarray(center)) - np.asarray(half))


def extrude(profile: np.ndarray, height: np.ndarray, half_height: float) -> np.ndarray:
    """The solid that a profile (P,) sweeps over ``|height| <= half_height``; height (P,)."""
    return _corner(np.stack([profile, np.abs(height) - half_height], axis=1))


def smooth_union(first: np.ndarray, second: np.ndarray, width: float) -> np.ndarray:
    """A union with a fillet where the two distances differ by less than ``width``."""
    overlap = np.maximum(width - np.abs(first - second), 0.0)
    return np.minimum(first, second) - overlap**2 / (4.0 * width)


def _corner(outside: np.ndarray) -> np.ndarray:
    """Distance to a right-angled corner from the signed distances (P, K) to its sides."""
    beyond = _length(np.maximum(outside, 0.0))
    return beyond + np.minimum(outside.max(axis=1), 0.0)


def _length(vectors: np.ndarray) -> np.ndarray:
    """Norm of each row; several times faster than numpy's for short rows."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
