"""λv of a dense scan, by points that the solver has not seen.

A share of the points is held out of the finest level that noise and spacing allow, and of what it
begins with. It is solved for half of its λv, λv and twice of it. Right is what misses these points
least, on the mean of

    (f(q)/a − (G f − f)(q))²,   a = mean ∇f(q)·n

Here G is a Gaussian with the noise's deviation: beside a bent surface a point q = p + e of noisy
coordinates does not lie at f = 0 on the mean, but at E f(p + e) = (G f)(p), that is by G f − f off.
Division by the slope a makes distances of f, which is flatter the more its points contradict it.
Then the level is solved with all points and the λv that is best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.energy import Energy, spread
from visco_core.grid.samples import Samples, at_corners, corner_weights, locate
from visco_core.grid.topology import Grid
from visco_core.kernels import Array
from visco_core.noise import Noise
from visco_core.pointcloud import PointCloud
from visco_core.presets import FAR_OFF
from visco_core.solvers.gauss_newton import GaussNewtonState
from visco_core.solvers.loop import Pace, Solver, minimise

SHARE, LARGEST_SHARE = 0.05, 0.1
"""Of the points, held out; and of a small scan."""

FEWEST, ENOUGH, MOST = 100, 500, 30_000
"""Points held out that say something, that are enough, and that suffice of a large scan."""

FARTHEST, FINER = 1.0, 0.5
"""Octaves of λv: how far from its middle a parabola may lead, and by how much more the mean
distance wants than points held out tell: their squares hear more of creases, which want less."""

DOUBT = 0.5
"""Standard errors that an octave from the law's λv must be better by; of two octaves four times."""

LEVELS = 3
"""The first ones, on which λv is looked for: on a fourth or fifth it takes a third of the time."""

STEADY, ROUGH, MOVED = 0.7, 0.02, 0.1
"""Points are unsteady where λv, from half to twice, moves the surface by more than so much of what
they are usually missed by, and by more voxels: up to that share of them, mostly at creases, whose
squares can outweigh all others and ask for ever less λv."""

SURE = 3.0
"""Standard errors that each further octave downwards must be better by."""

COARSEST_DOWN = 2
"""Octaves downwards at most on the coarsest level, where creases ask for ever less."""


@dataclass(frozen=True)
class HeldOut:
    """A scan parted in two.

    ``seen``: points (P, 3) in [0, 1]³ and their fitted normals (P, 3) or None. ``points`` and
    ``normals`` (H, 3): the others, and as large a share of those that cleaning has dropped, since
    what it leaves has less noise than the scan. ``deviation`` of the noise, in units of the cube;
    ``level`` on which λv is looked for.
    """

    seen: tuple[np.ndarray, np.ndarray | None]
    points: np.ndarray
    normals: np.ndarray
    deviation: float
    level: int


def searched_level(noise: Noise, resolutions: list[int]) -> int:
    """The finest of the first ``LEVELS`` with voxels as wide as the noise and as the points lie
    apart; the coarsest if even the second has narrower ones.

    In wider noise f is no distance where the outermost points are. If the second level has it,
    smoothing reaches so far that finer levels do not make up for that of the coarsest.
    """
    wide = max(noise.position, noise.spacing)
    return max(sum(wide * resolution <= 1 for resolution in resolutions[:LEVELS]) - 1, 0)


def hold_out(
    points: np.ndarray,
    normals: np.ndarray,
    fitted: np.ndarray | None,
    dropped: PointCloud,
    deviation: float,
    level: int,
    seed: int,
) -> HeldOut:
    """Parts ``points`` and ``normals`` (P, 3) and the ``dropped``, if they have both, at random."""
    rng = np.random.default_rng(seed)
    share = min(np.clip(ENOUGH / len(points), SHARE, LARGEST_SHARE), MOST / len(points))
    seen = rng.random(len(points)) >= share
    held = points[~seen], normals[~seen]
    if dropped.normals is not None:
        others = rng.random(len(dropped)) < share
        held = (
            np.concatenate([held[0], dropped.points[others]]),
            np.concatenate([held[1], dropped.normals[others]]),
        )
    known = points[seen], None if fitted is None else fitted[seen]
    return HeldOut(known, *held, deviation, level)


def choose_factor(
    energy: Energy,
    begin: Array,
    solver: Solver[GaussNewtonState],
    pace: Pace,
    held: HeldOut,
) -> tuple[float, Array]:
    """The factor of λv with which the points held out are missed least, and the solution near it.

    It is 1 where the pace is late or too few points are held out. A parabola through the errors of
    half, once and twice λv, in log λv, says what is best; see ``FINER`` and ``DOUBT``. It goes as
    far as both all points and the steady ones want, see ``MOVED``. Where that is half, the next
    goes through a quarter, half and once, and so on for as long as less is surely better, see
    ``SURE`` and ``COARSEST_DOWN``. Neither ``energy`` nor ``begin`` (N + 1,) may know those points.
    Raises Stopped.
    """
    grid, viscosity = energy.grid, energy.weights.viscosity
    samples = locate(grid, held.points, held.normals, pace.check)

    def solved(octave: int) -> Array:
        other = energy.with_viscosity(weight=2**octave * viscosity)
        return minimise(solver, other, begin, pace, lambda _: None).values

    solutions = {octave: solved(octave) for octave in (0, -1, 1)}
    shift = -solutions[0]
    shift += spread(grid, solutions[0], held.deviation * grid.resolution, pace.check)

    def missed(octave: int) -> np.ndarray:
        return _distances(grid, solutions[octave], shift, samples)

    distances = {octave: missed(octave) for octave in solutions}
    usual = np.median(np.abs(distances[0]))
    near = np.abs(distances[0]) < FAR_OFF * usual

    def worse(octave: int) -> list[np.ndarray]:
        """(2, P) by how much more half and twice of a λv miss points: all, and the steady ones."""
        less, here, more = (distances[octave + step][near] for step in (-1, 0, 1))
        moved, both = np.abs(more - less), np.stack([less**2 - here**2, more**2 - here**2])
        most = max(STEADY * usual, ROUGH / grid.resolution, np.quantile(moved, 1 - MOVED))
        return [both, both[:, moved <= most]]

    if pace.late() or near.sum() < FEWEST:
        return 1.0, solutions[0]
    octave, lowest = _agreed(worse(0)), 0
    bound = -COARSEST_DOWN if grid.is_dense else -np.inf
    while octave == lowest - FARTHEST and octave > bound:
        lowest -= 1
        solutions[lowest - 1] = solved(lowest - 1)
        distances[lowest - 1] = missed(lowest - 1)
        told = worse(lowest)
        (less, _), _ = told
        if pace.late() or less.mean() > -SURE * less.std() / np.sqrt(len(less)):
            break
        octave = lowest + min(_agreed(told), 0.0)
    return 2**octave, solutions[round(octave)]


def _agreed(told: list[np.ndarray]) -> float:
    """As far as all of them want to go, or nowhere."""
    return float(np.median([0.0, *(_least(less, more) for less, more in told)]))


def _least(less: np.ndarray, more: np.ndarray) -> float:
    """Octaves of λv to go, where half and twice of it miss the points (P,) by so much more.

    The least of the parabola through 0 and their means, to which the doubt is added.
    """
    doubt = DOUBT * (less.std() + more.std()) / 2 / np.sqrt(len(less))
    bent, slope = (less.mean() + more.mean()) / 2 + doubt, (more.mean() - less.mean()) / 2
    if bent <= 0:
        return -FARTHEST if slope > 0 else FARTHEST
    best = -slope / 2 - doubt * FINER
    return float(np.clip(best / bent + FINER, -FARTHEST, FARTHEST))


def _distances(grid: Grid, values: Array, shift: Array, samples: Samples) -> np.ndarray:
    """(P,) signed distances from the surface of ``values`` (N + 1,) less ``shift`` (N + 1,)."""
    numpy = grid.backend.numpy
    away, along = corner_weights(numpy(samples.local))
    given = at_corners(grid, samples, values), along, numpy(samples.normals)
    slope = float(np.einsum("pc,pac,pa->p", *given).mean()) * grid.resolution
    offset = at_corners(grid, samples, values / slope - shift)
    distances: np.ndarray = np.einsum("pc,pc->p", offset, away)
    return distances
