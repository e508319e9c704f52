"""The gallery: solids whose surface is known exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from visco_core.gallery import implicit
from visco_core.gallery.bracket import bracket
from visco_core.gallery.octopus import octopus
from visco_core.gallery.shape import Shape


def sphere(radius: float = 1.0) -> Shape:
    return Shape(
        "sphere", lambda p: implicit.sphere(p, np.zeros(3), radius), _box(radius), exact=True
    )


def torus(major: float = 0.7, minor: float = 0.28) -> Shape:
    reach = major + minor
    return Shape(
        "torus",
        lambda p: implicit.torus(p, major, minor),
        _box((reach, reach, minor)),
        exact=True,
        genus=1,
    )


def bumpy_torus(
    major: float = 0.7, minor: float = 0.26, height: float = 0.035, bumps: tuple[int, int] = (12, 5)
) -> Shape:
    """A torus with ``bumps[0]`` waves around its axis and ``bumps[1]`` around its tube."""
    # Within three heights of the tube the bumps add at most this slope; beyond, where the angles
    # turn ever faster, halving the value suffices for it never to overstate the distance.
    slope = height * np.hypot(
        bumps[0] / (major - minor - 3.0 * height), bumps[1] / (minor - 3.0 * height)
    )
    lipschitz = max(2.0, 1.0 + slope)
    reach = minor + height

    def sdf(points: np.ndarray) -> np.ndarray:
        ring = np.hypot(points[:, 0], points[:, 1]) - major
        around = np.arctan2(points[:, 1], points[:, 0])
        tube = np.arctan2(points[:, 2], ring)
        bump = height * np.cos(bumps[0] * around) * np.cos(bumps[1] * tube)
        return (np.hypot(ring, points[:, 2]) - minor - bump) / lipschitz

    bounds = _box((major + reach, major + reach, reach))
    return Shape("bumpy_torus", sdf, bounds, genus=1)


def box(half: tuple[float, float, float] = (0.8, 0.6, 0.5)) -> Shape:
    """A box with sharp edges."""
    return Shape("box", lambda p: implicit.box(p, np.zeros(3), half), _box(half), exact=True)


def thin_plate(thickness: float = 0.03) -> Shape:
    """A sharp-edged plate, by default about four voxels thick on a grid of 256."""
    half = (0.9, 0.6, 0.5 * thickness)
    return Shape("thin_plate", lambda p: implicit.box(p, np.zeros(3), half), _box(half), exact=True)


def two_bodies() -> Shape:
    """A ball and a box that do not touch."""

    def sdf(points: np.ndarray) -> np.ndarray:
        ball = implicit.sphere(points, (-0.5, 0.0, 0.0), 0.45)
        cube = implicit.box(points, (0.5, 0.1, 0.0), (0.35, 0.3, 0.4))
        return np.minimum(ball, cube)

    bounds = np.array([[-0.95, -0.45, -0.45], [0.85, 0.45, 0.45]])
    return Shape("two_bodies", sdf, bounds, exact=True, bodies=2)


SHAPES: dict[str, Callable[[], Shape]] = {
    maker.__name__: maker
    for maker in (sphere, torus, bumpy_torus, box, thin_plate, two_bodies, bracket, octopus)
}


def _box(half: float | tuple[float, float, float]) -> np.ndarray:
    corner = np.broadcast_to(np.asarray(half, dtype=np.float64), 3)
    return np.stack([-corner, corner])
