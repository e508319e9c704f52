"""λv of a dense scan, by points that the solver has not seen.

The coarsest level is made to forget a share of the points, and the second, or the coarsest itself
where noise is wide, is solved without them for half of its λv, λv and twice of it. Right is what
misses these points least, on the mean of

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
"""Octaves of λv: how far from its middle a parabola may lead, and by how much more the finest level
wants than points held out of a coarser one tell. A mean of their squares hears more of creases,
which want less, than the mean distance does."""

DOUBT = 0.5
"""Standard errors that an octave from the law's λv must be better by; of two octaves four times."""


@dataclass(frozen=True)
class HeldOut:
    """A scan parted in two.

    ``seen``: points (P, 3) in [0, 1]³ and their fitted normals (P, 3) or None. ``points`` and
    ``normals`` (H, 3): the others, and as large a share of those that cleaning has dropped, since
    what it leaves has less noise than the scan. ``deviation`` of the noise and ``spacing`` of the
    points, in units of the cube.
    """

    seen: tuple[np.ndarray, np.ndarray | None]
    points: np.ndarray
    normals: np.ndarray
    deviation: float
    spacing: float

    def level(self, resolutions: list[int]) -> int:
        """On which λv is looked for: the second, or the coarsest if noise is wider than a voxel of
        the second, or points lie farther apart.

        Smoothing then reaches so far that finer levels cannot make up for too much or too little on
        the coarsest; in such noise f is no distance on them where the outermost points are.
        """
        return int(max(self.deviation, self.spacing) * resolutions[1] <= 1)


def hold_out(
    points: np.ndarray,
    normals: np.ndarray,
    fitted: np.ndarray | None,
    dropped: PointCloud,
    noise: Noise,
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
    return HeldOut(known, *held, deviation=noise.position, spacing=noise.spacing)


def choose_factor(
    energy: Energy,
    begin: Array,
    solver: Solver[GaussNewtonState],
    pace: Pace,
    held: HeldOut,
) -> float:
    """The factor of λv with which the points held out are missed least.

    It is 1 where the pace is late or too few points are held out. A parabola through the errors of
    half, once and twice λv, in log λv, says what is best; see ``FINER`` and ``DOUBT``. Where that
    is half, and one through a quarter, half and once says half again, it is a quarter. Neither
    ``energy`` nor ``begin`` (N + 1,) may know those points. Raises Stopped.
    """
    grid, viscosity = energy.grid, energy.weights.viscosity
    samples = locate(grid, held.points, held.normals, pace.check)

    def solved(octave: float) -> Array:
        other = energy.with_viscosity(weight=2**octave * viscosity)
        return minimise(solver, other, begin, pace, lambda _: None).values

    values = solved(0)
    shift = spread(grid, values, held.deviation * grid.resolution, pace.check) - values

    def missed(values: Array) -> np.ndarray:
        return np.square(_distances(grid, values, shift, samples))

    here, less, more = missed(values), missed(solved(-1)), missed(solved(1))
    near = here < FAR_OFF**2 * np.median(here)
    if pace.late() or near.sum() < FEWEST:
        return 1.0
    octave = _least(less[near] - here[near], more[near] - here[near])
    if octave == -FARTHEST:
        least = missed(solved(-2))
        again = _least(least[near] - less[near], here[near] - less[near])
        if again == -FARTHEST and not pace.late():
            octave += again
    return 2**octave


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
