"""What the sides of oriented points say: of those of their neighbours, and of what they enclose."""

from __future__ import annotations

import numpy as np

LATERAL = 0.2
"""Sine of the angle out of a point's plane at which a neighbour counts 1/e of one within."""

LOOSE = 1e-3
"""Weight of a neighbour out of the plane, as far as the grouping goes: a last resort."""

DENSITIES = (0.7, 1.0, 1.4, 2.0)
"""The factors by which areas may be misjudged, f in ``orientation.py``; each is tried."""

CLOSED = 0.07
"""A scan whose winding numbers miss ½ by more than the square root of this is open."""

OPEN = 0.2
"""Least length of the mean normal of an open surface: none if closed, ½ for half a sphere."""

SOFTENING = 0.4
"""Radius within which a sample's pull on others is bounded, in square roots of its area."""


def side_agreement(
    points: np.ndarray, directions: np.ndarray, source: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far two directions lie on one side, −1 to 1: for the grouping (E,), for the solve (E,).

    The second is n·m', m' being the other direction mirrored in the plane between the points: the
    normals of a sphere agree fully at any distance. Between parallel walls, where both planes rise
    alike towards the other point, it says nothing, and fades as that rise grows. The first is n·m,
    and fades for any neighbour out of the plane.
    """
    apart = points[target] - points[source]
    apart /= np.maximum(np.sqrt(np.einsum("ei,ei->e", apart, apart)), 1e-300)[:, None]
    first, second = directions[source], directions[target]
    rise, other = np.einsum("ei,ei->e", first, apart), np.einsum("ei,ei->e", second, apart)
    alike = np.einsum("ei,ei->e", first, second)
    steep, both = np.maximum(rise**2, other**2), rise * other
    within = np.maximum(np.exp(-steep / LATERAL**2), LOOSE)
    apart_alike = np.exp(-np.maximum(alike * both, 0) / LATERAL**2)
    return within * alike, apart_alike * (alike - 2 * both)


def nearest_axis(normals: np.ndarray) -> np.ndarray:
    """(P,) int64, 0 to 5: which of −x, x, −y, y, −z and z each of normals (P, 3) is nearest to."""
    axis = np.abs(normals).argmax(1)
    ahead: np.ndarray = np.take_along_axis(normals, axis[:, None], 1)[:, 0] > 0
    return 2 * axis + ahead


def disc_areas(
    points: np.ndarray, directions: np.ndarray, sources: np.ndarray, around: np.ndarray
) -> np.ndarray:
    """The surface (S,) that each source stands for, from how far its neighbours lie in its plane.

    Of k neighbours in a disc of K points the mean squared distance is half the squared radius.
    """
    apart = points[around[:, 1:]] - points[sources, None]
    height = np.einsum("ski,si->sk", apart, directions[sources])
    spread = (np.einsum("ski,ski->sk", apart, apart) - height**2).mean(1)
    return 2 * np.pi * spread / (around.shape[1] - 0.5)
