"""Which of a scan's normals point to the wrong side.

Tools often leave normals without orientation, or turn some of them, whole parts or all wrongly.
Neighbours then contradict each other where no choice of sides would have to, or the winding number
on a closed surface, ½ with outward normals, is −½ (``orientation.py`` says more of both). A few
places tell, so a scan with good normals pays little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.facing import CLOSED, DENSITIES, OPEN, SOFTENING, disc_areas, side_agreement
from visco_core.neighbours import Neighbours
from visco_core.progress import Check, never

POINTS = 100_000
"""Neighbours in a larger scan are looked for among so many."""

PROBES, AROUND, PLACES = 2000, 9, 500
"""Neighbourhoods that are looked at, their points, and those where winding numbers are taken."""

CONTRADICTION = 0.005
"""Share of what neighbours say of each other's sides that may be contradiction in a good scan."""

NEEDLESS = 0.25
"""Contradiction is needless where less than this of it is left with the best sides: noise leaves a
half, and normals turned at random nothing."""

TWO_WALLS = 0.1
"""Correlation of side and height that two close walls have at least, for a few turned at random
have none."""

INWARD = 0.02
"""Share of places that may have a winding number below −¼ in a good scan."""

CLEARLY = 0.5
"""Other sides win where they leave less than this of the misfit or of the contradiction."""

VOTERS, ROUNDS = 32, 8
"""Neighbours that a point follows, and how often: 16 leave clusters wrong, of 30 % turned."""

PIECE = 2**14
"""How many points are worked on between two questions whether to stop."""


def wrong_sides(
    points: np.ndarray, normals: np.ndarray, threads: int = -1, check: Check = never
) -> np.ndarray:
    """(P,) bool: which of the unit ``normals`` (P, 3) at ``points`` (P, 3) are turned wrongly.

    None are where they agree with each other on an open surface, which has no outside, and none on
    walls so close that the points mix, whose normals differ much as if turned at random.
    """
    wrong = np.zeros(len(points), bool)
    if len(points) < 10 * AROUND:
        return wrong
    points = (points - points.mean(0)) / np.ptp(points, axis=0).max()
    normals = normals.astype(np.float64)
    probes = _Probes.of(points, normals, threads, check)
    sides = np.ones(len(points))
    found = probes.look(sides)
    mixed = found.needless and not found.two_walls
    if mixed:
        sides = _voted(points, normals, threads, check)
        found = probes.look(sides, CONTRADICTION / 10)
    if found.inside_out:
        mirrored = probes.look(-sides)
        if mirrored.closed and mirrored.misfit < CLEARLY * found.misfit:
            return sides > 0
    doubtful = found.open < OPEN or found.contradiction > CONTRADICTION
    if (mixed and found.needless) or (doubtful and found.inward > INWARD):
        from visco_core.normals import outward_sides

        other = outward_sides(points, normals, threads, check)
        better = probes.look(other)
        if not better.closed and other @ sides < 0:
            other = -other
            better = probes.look(other)
        turns = better.closed and better.misfit < CLEARLY * found.misfit
        agrees = mixed and better.contradiction < CLEARLY * found.contradiction
        if turns or (agrees and better.misfit < found.misfit / CLEARLY):
            sides = other
    return sides < 0


@dataclass(frozen=True)
class _Look:
    """What one choice of sides looks like; misfit: the windings' mean squared distance to ½."""

    contradiction: float
    needless: bool
    two_walls: bool
    inside_out: bool
    inward: float
    misfit: float
    open: float

    @property
    def closed(self) -> bool:
        return self.misfit < CLOSED and self.open < OPEN


@dataclass(frozen=True)
class _Probes:
    """Neighbourhoods near (S, K) of a scan, what pairs (S, K, K) of their points say of each other,
    and the winding (Q, S) that each one's middle normal gives at places."""

    points: np.ndarray
    normals: np.ndarray
    near: np.ndarray
    agreement: np.ndarray
    area: np.ndarray
    winding: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, normals: np.ndarray, threads: int, check: Check) -> _Probes:
        shuffled = np.random.default_rng(0).permutation(len(points))
        among, chosen = np.sort(shuffled[:POINTS]), shuffled[:PROBES]
        look_up = Neighbours(points[among], threads, check)
        near = among[look_up.nearest(points[chosen], AROUND)[1]]
        check()
        first, second = np.triu_indices(AROUND, 1)
        said = side_agreement(points, normals, near[:, first].ravel(), near[:, second].ravel())[1]
        agreement = np.zeros((len(near), AROUND, AROUND))
        agreement[:, first, second] = agreement[:, second, first] = said.reshape(len(near), -1)
        check()
        area = disc_areas(points, normals, chosen, near) * len(among) / len(chosen)
        pull = normals[chosen] * area[:, None] / (4 * np.pi)
        apart = points[chosen] - points[chosen[:PLACES], None]
        distance = np.einsum("qsi,qsi->qs", apart, apart) + SOFTENING**2 * np.median(area)
        winding = np.einsum("qsi,si->qs", apart, pull) / (distance * np.sqrt(distance))
        return cls(points[near], normals[near], near, agreement, area, winding)

    def look(self, sides: np.ndarray, allowed: float = CONTRADICTION) -> _Look:
        """What ``sides`` (P,) ±1 look like, with so much contradiction ``allowed``."""
        near = sides[self.near]
        said = self.agreement * near[:, :, None] * near[:, None]
        total = np.abs(said).sum((1, 2))
        against = np.maximum(-said, 0).sum((1, 2))
        best = np.where(np.linalg.eigh(said)[1][:, :, -1] < 0, -1.0, 1.0)
        left = np.maximum(-said * best[:, :, None] * best[:, None], 0).sum((1, 2))
        contradiction = against.sum() / total.sum()
        left = np.minimum(left, against).sum()
        needless = contradiction > allowed and left < NEEDLESS * against.sum()
        walls = abs(self._two_walls(near, best, against > 0.1 * total)) > TWO_WALLS
        winding = self.winding @ near[:, 0]
        misfit = min(float(np.square(0.5 - f * winding).mean()) for f in DENSITIES)
        inward = float((winding < -0.25).mean())
        mean = (self.area * near[:, 0]) @ self.normals[:, 0] / self.area.sum()
        opening = float(np.linalg.norm(mean))
        inside_out = winding.mean() < 0
        return _Look(contradiction, needless, walls, inside_out, inward, misfit, opening)

    def _two_walls(self, near: np.ndarray, best: np.ndarray, those: np.ndarray) -> float:
        """How far the points of ``those`` (S,) that face one way also lie on that side, −1 to 1.

        near, best (S, K): the sides of their points, and those that would agree.
        """
        along = self.normals[those] * (near * best)[those][:, :, None]
        upward = along.mean(1)
        upward /= np.maximum(np.linalg.norm(upward, axis=1, keepdims=True), 1e-12)
        away = self.points[those] - self.points[those].mean(1, keepdims=True)
        height = np.einsum("ski,si->sk", away, upward)
        side = best[those] - best[those].mean(1, keepdims=True)
        widths = np.sqrt(np.square(height).sum(1) * np.square(side).sum(1)).sum()
        return float((height * side).sum() / max(widths, 1e-300))


def _voted(points: np.ndarray, normals: np.ndarray, threads: int, check: Check) -> np.ndarray:
    """(P,) ±1: the side that most of its neighbours give each point, asked again and again."""
    look_up = Neighbours(points, threads, check)
    near = np.empty((len(points), VOTERS), np.int32)
    agreement = np.empty((len(points), VOTERS), np.float32)
    for start in range(0, len(points), PIECE):
        check()
        part = np.arange(start, min(start + PIECE, len(points)))
        near[part] = look_up.nearest(points[part], VOTERS + 1)[1][:, 1:]
        source = np.repeat(part, VOTERS)
        said = side_agreement(points, normals, source, near[part].ravel())[1]
        agreement[part] = said.reshape(-1, VOTERS)
    sides = np.ones(len(points), np.float32)
    for _ in range(ROUNDS):
        check()
        vote = np.einsum("pk,pk->p", agreement, sides[near])
        sides = np.where(vote * sides < 0, -sides, sides)
    return sides.astype(np.float64)
