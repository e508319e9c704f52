"""How a surface bends: by how much quadrics of some radius miss it at their middle.

Smoothing over a radius moves the surface by about as much. The scan is split in two halves, each
thinned to a quarter again and again, so that the same number of neighbours reaches twice as far. At
sampled points a quadric of one half is compared with one of half its radius of the other half:
halves have no noise in common, so it adds to what they differ by a variance that is known, and can
be taken off. Two quadrics of the same radius tell the noise itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from visco_core.neighbours import Neighbours
from visco_core.progress import Check
from visco_core.quadrics import MEDIAN_SQUARE, NEIGHBOURS, SAMPLES, Quadrics

HALF, THINNING, FEWEST = 50_000, 4, 60
"""Points of a half at first, at most; one in so many is kept for the next; points at least."""

ONE_SIDE, FARTHEST = 12, 4.0
"""Neighbours on a point's own side with which it is compared, and the largest variance, in that of
the noise: elsewhere quadrics are extrapolated."""

NARROWED = 0.8
"""The nearest points are those that noise has brought near: (1 + NARROWED σ²/radius²) is off it."""

WIDE = 2.5
"""Deviations of the noise that the radius of the finer quadric must have to be compared with."""

SEEN = 0.2
"""What the bending must add to the square of the halves' difference, as a share of what the noise
does, whose deviation is known to 5 %."""

LEAST_POWER, USUAL_POWER, GREATEST_POWER = 1.75, 3.0, 4.0
"""Powers of the radius that a quadric's error is taken to grow with below the radii that show it. A
crease's grows with 1.5, but what few points show at large radii are whole parts of the shape."""


@dataclass(frozen=True)
class _Half:
    """Quadrics through the K neighbours of S places in a half, and how far these reach (S,).

    facing (S, K) bool: the neighbours on the place's own side.
    """

    quadrics: Quadrics
    reach: np.ndarray
    facing: np.ndarray

    @classmethod
    def of(
        cls,
        half: tuple[np.ndarray, np.ndarray],
        places: np.ndarray,
        facing: np.ndarray,
        threads: int,
        check: Check,
    ) -> _Half:
        points, normals = half
        away, near = Neighbours(points, threads, check).nearest(places, NEIGHBOURS)
        check()
        side = np.einsum("ski,si->sk", normals[near], facing) > 0
        fitted = side | (side.sum(1, keepdims=True) < ONE_SIDE)
        return cls(Quadrics.through(points[near], fitted), away[:, -1], side)

    def differs(self, finer: _Half, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The square of what it differs by from a ``finer`` one, and what noise makes of it.

        Under the ``places`` (S, 3), where both have seen enough of the same side.
        """
        height, variance = finer.quadrics.above(places)
        foot = places - height[:, None] * finer.quadrics.axes[:, :, 0]
        apart, further = self.quadrics.above(foot)
        variance += further
        told = np.minimum(self.facing.sum(1), finer.facing.sum(1)) >= ONE_SIDE
        told &= variance < FARTHEST
        return np.minimum(np.abs(apart), self.reach)[told] ** 2, variance[told]


@dataclass(frozen=True)
class Scale:
    """What two halves' quadrics of one radius tell: the noise, and the share of points beyond.

    ``missed`` is the mean square of what they differ by from quadrics of half the radius of the
    other half, ``variance`` what noise of variance 1 makes of it.
    """

    radius: float
    noise: float
    other_wall: float
    missed: float
    variance: float


def scales(
    points: np.ndarray,
    normals: np.ndarray,
    random: np.random.Generator,
    threads: int,
    check: Check,
) -> Iterator[Scale]:
    """From the smallest radius on; of the first ``missed`` and ``variance`` are not a number."""
    looked = random.choice(len(points), min(SAMPLES, len(points)), replace=False)
    places, facing = points[looked], normals[looked]
    order, size = random.permutation(len(points)), min(len(points) // 2, HALF)
    before: list[_Half] = []
    while size >= FEWEST:
        parts = order[:size], order[-size:]
        one, other = (
            _Half.of((points[part], normals[part]), places, facing, threads, check)
            for part in parts
        )
        apart, variance = one.differs(other, places)
        if not len(apart):
            return
        radius = max(float(np.median(one.reach)), np.finfo(float).tiny)
        noise = math.sqrt(float(np.median(apart / variance)) / MEDIAN_SQUARE)
        noise *= 1 + NARROWED * (noise / radius) ** 2
        beyond = 1 - float(np.median(one.facing.mean(1)))
        missed = varied = np.empty(0)
        if before:
            each = one.differs(before[1], places), other.differs(before[0], places)
            missed, varied = (np.concatenate(pair) for pair in zip(*each, strict=True))
        yield Scale(radius, noise, beyond, _mean(missed), _mean(varied))
        before = [one, other]
        size //= THINNING


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


def bending(reach: float, seen: list[Scale], noise: float) -> float | None:
    """By how much quadrics of radius ``reach`` miss the surface at their middle; None if unknown.

    Where it shows in spite of the noise at the largest radii it is read between these, and below
    the smallest of them goes with the power of the radius that the two smallest show.
    """
    radii: list[float] = []
    bent: list[float] = []
    compared = [each for each in seen if each.missed > 0]
    for scale in reversed(compared):
        expected = scale.variance * noise**2
        shows = scale.missed > (1 + SEEN) * expected and scale.radius > 2 * WIDE * noise
        if shows or not radii:
            radii.append(math.log(scale.radius))
            bent.append(math.log(max(scale.missed - expected, SEEN * expected)) / 2)
        if not shows:
            break
    if not radii:
        return None
    radii, bent = radii[::-1], bent[::-1]
    power = USUAL_POWER if len(compared) > 1 else LEAST_POWER
    if len(radii) > 1:
        power = (bent[1] - bent[0]) / (radii[1] - radii[0])
        power = min(max(power, LEAST_POWER), GREATEST_POWER)
    below = min(math.log(reach) - radii[0], 0.0)
    return math.exp(power * below + float(np.interp(math.log(reach), radii, bent)))
