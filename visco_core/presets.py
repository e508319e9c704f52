"""The settings that a run really uses: what the user said, and the profile's values elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from visco_core.config import LossWeights, ReconstructionConfig

if TYPE_CHECKING:
    from visco_core.noise import Noise

Search = Literal["none", "leave_one_out", "held_out"]


@dataclass(frozen=True)
class Weights:
    """λp, λn, λv, λc, ε and β, all decided; see ``config.LossWeights``."""

    point: float
    normal: float
    viscosity: float
    coarea: float
    viscosity_epsilon: float
    coarea_beta: float


@dataclass(frozen=True)
class Schedule:
    """The level schedule, all decided; see ``config.LevelSchedule``."""

    outer_steps: tuple[int, ...]
    inner_steps: tuple[int, ...]
    epochs: tuple[int, ...]
    iterations: int
    batch_fraction: float
    learning_rate: float
    band_width: float


@dataclass(frozen=True)
class Settings:
    """A config with nothing left open; ``weights`` of each level, coarsest first.

    ``search``: how the second level looks for a better λv; see the modules of these names.
    ``keeps``: whether a level keeps the viscosity residual of the coarser one near points.
    """

    config: ReconstructionConfig
    weights: tuple[Weights, ...]
    schedule: Schedule
    search: Search = "none"
    keeps: bool = False

    def with_viscosity_times(self, factor: float, level: int) -> Settings:
        """The same with ``factor`` times λv from ``level`` on, within its bounds."""
        coarser, finer = self.weights[:level], self.weights[level:]
        bounds = LEAST_VISCOSITY, 2 * GREATEST_VISCOSITY
        scaled = [float(np.clip(factor * each.viscosity, *bounds)) for each in finer]
        changed = (replace(w, viscosity=v) for w, v in zip(finer, scaled, strict=True))
        return replace(self, weights=(*coarser, *changed))


PAPER_WEIGHTS = Weights(
    point=0.1,
    normal=1e-5,
    viscosity=1e-4,
    coarea=1e-6,
    viscosity_epsilon=1e-2,
    coarea_beta=1e-2,
)
"""Section 4 of the paper; it does not give β."""

FAST_WEIGHTS = Weights(
    point=0.1,
    normal=3e-5,
    viscosity=1e-5,
    coarea=0.0,
    viscosity_epsilon=5e-3,
    coarea_beta=1e-2,
)
"""λn and λv are those of a scan whose noise is not known; see ``weights_for_noise``."""

SMOOTHED = 11 * FAST_WEIGHTS.viscosity_epsilon
"""Radius, in units of the cube, over which a quadric misses the surface about as the solution does,
whatever λv."""

BEND_ERROR, BEND_POWER = 12.0, 0.7
"""What the solution's error from smoothing is, over that power of λv and over that of a quadric."""

CURVE_ERROR, CURVE_VISCOSITY = FAST_WEIGHTS.viscosity_epsilon**2, 1e-3
"""Error on the smoothest shapes, in units of the cube, that ever larger λv tends to, and λv with
which it is half of it."""

NOISE_ERROR = 2.4
"""What is left of the noise, times λv^¼, over the noise and over the spacing of the points."""

ROUGHNESS = 0.005
"""What trilinear voxels make of exact points, as noise, in voxels."""

SHARED_NOISE = 0.37
"""How much noise counts that neighbours share, since a mean over them keeps it. A scan whose own
normals are planes through points has mostly been put together from views, which do not agree."""

LEAST_VISCOSITY, GREATEST_VISCOSITY = 1e-6, 0.1
"""λv below which stray pieces appear, and beyond which the levels' iterations do not suffice for
scans with little noise; points held out may ask for twice as much."""

THIN_WALL, NEARER = 5.0, 0.6
"""λv^¼ over the radius, in units of the cube, at which other walls come near: with more they run
together. The noise brings them nearer than they are, by so many of its deviations."""

VOXEL_ERROR = 0.1
"""What trilinear voxels add to the noise of the points, as a share of a voxel."""

VOXEL_ERROR_OF_NORMALS = 0.02
"""How much of that counts when normals are weighed against exact points on the finer levels, where
the slope of a trilinear voxel is further from the surface's than most normals; as much as the noise
counts where there is some. On the coarsest level all of it does: there the normals lead the surface
from what was seen into the holes."""

SPARSE = 6.0
"""Deviations of the noise from which on points lie far apart: a surface can hardly fold so as to
follow their noise, so it tells what it makes of points that are left out."""

FAR_OFF = 15.0
"""Over the median distance from the surface, how far points may be that λv is looked for by: what
is farther away says nothing of it."""

SHARED_NORMAL_ERROR, SHARED_IN_HOLES = 0.07, 0.135
"""Error of the normals, in radians, that neighbours share and that their scatter does not show:
what a scanner's normals are smoothed by. On the coarsest level normals lead the surface far from
where they were measured, and less is to be made of them."""

KEPT_OVER = 0.055
"""Radius, in units of the cube and times λv^¼, over which the viscosity residual that a level keeps
of the coarser one is a mean: what smoothing took from the shape, without the noise."""

PAPER_EPOCHS = {30: (5, 5, 3), 21: (2, 2, 2), 15: (2, 2, 2), 8: (2, 2, 1)}
"""Minutes of the paper's budget table → epochs on each level."""

PAPER_PRUNE = {30: 12.0, 21: 12.0, 15: 6.0, 8: 6.0}
"""Voxels kept on either side of the surface, for the paper's t = 0.9 and t = 0.4 (erratum 3)."""

FAST_OUTER_STEPS, FAST_INNER_STEPS, FAST_BAND_WIDTH = (4, 2), (30, 30), 4.0


def weights_for_noise(
    noise: Noise, resolutions: list[int], *, derived: bool = False, shared: bool = False
) -> tuple[Weights, ...]:
    """The weights of the profile ``fast`` on each level for a scan's noise in units of the cube.

    Maximum a posteriori: m points of variance σ² and normals of variance σn² weigh λp/m : λn/m as
    1/σ² : 1/σn², so λn = λp σ² / σn², where σ² is the noise and what the level's voxels add to it,
    and σn² the scatter of the normals and the error that neighbours share.

    λv is that with the least error, expected from two sides (``expected_error``).

    ``derived`` normals were computed from the points. They repeat what these say, errors included,
    so they count on the coarsest level alone. ``shared``: neighbours share their noise.
    """
    base = FAST_WEIGHTS
    variance = noise.position**2
    counted = replace(noise, position=SHARED_NOISE * noise.position) if shared else noise

    def on_level(level: int, resolution: int) -> Weights:
        voxel = (VOXEL_ERROR / resolution) ** 2
        for_normals = max(VOXEL_ERROR_OF_NORMALS * voxel, min(voxel, variance)) if level else voxel
        common = SHARED_NORMAL_ERROR if level else SHARED_IN_HOLES
        normal = base.point * (variance + for_normals) / (noise.normal**2 + common**2)
        if derived and level:
            normal = 0.0
        viscosity = _best_viscosity(counted, resolution)
        return replace(base, normal=min(normal, 1e-3), viscosity=viscosity)

    return tuple(on_level(*entry) for entry in enumerate(resolutions))


def expected_error(noise: Noise, resolution: int, viscosity: np.ndarray) -> np.ndarray:
    """By how much the surface will be off with λv ``viscosity``, in units of the cube.

    Smoothing takes from the shape, with b the bending,

        CURVE_ERROR · λv/(λv + CURVE_VISCOSITY) + BEND_ERROR · b λv^BEND_POWER,

    and leaves of noise in points with the spacing s the share

        x/√(1 + x²) where x = NOISE_ERROR · s/λv^¼,

    since the viscosity resists a ripple of wave number k as λv k⁴, so it takes the mean over a
    radius that grows as λv^¼. On n voxels an axis there is the noise of the points, and that of
    ROUGHNESS voxels, one voxel apart where the points are not closer. All three are squared and
    added.
    """
    bent = BEND_ERROR * noise.bending * viscosity**BEND_POWER
    shape = CURVE_ERROR * viscosity / (viscosity + CURVE_VISCOSITY) + bent
    error: np.ndarray = np.square(shape)
    voxel = 1 / resolution
    rough = ROUGHNESS * voxel, min(noise.spacing, voxel)
    for deviation, spacing in ((noise.position, noise.spacing), rough):
        means = NOISE_ERROR * spacing / viscosity**0.25
        error = error + np.square(deviation * means / np.hypot(1, means))
    return np.sqrt(error)


def _best_viscosity(noise: Noise, resolution: int) -> float:
    """λv with the least expected error that keeps walls apart; of a scan too small to tell, any."""
    if not noise.spacing:
        return FAST_WEIGHTS.viscosity
    wall = noise.wall + NEARER * noise.position
    greatest = min((THIN_WALL * wall) ** 4, GREATEST_VISCOSITY)
    tried = np.geomspace(LEAST_VISCOSITY, max(greatest, LEAST_VISCOSITY), 200)
    return float(tried[expected_error(noise, resolution, tried).argmin()])


def viscosity_search(noise: Noise, resolutions: list[int], *, shared: bool = False) -> Search:
    """How points that are left out shall tell λv.

    Each in turn where they lie farther apart than the voxels of the second level and ``SPARSE``
    deviations. In denser scans a share of them, which the mesh is made of too: not where neighbours
    ``shared`` their noise, and so foretell each other's.
    """
    if len(resolutions) == 1:
        return "none"
    if noise.spacing > max(1 / resolutions[1], SPARSE * noise.position):
        return "leave_one_out"
    return "none" if shared or not noise.spacing else "held_out"


def decide(
    config: ReconstructionConfig,
    weights: tuple[Weights, ...] | None = None,
    search: Search = "none",
) -> Settings:
    """``config`` with every None filled in: by ``weights`` if given, else by the profile.

    λv is looked for while solving as ``search`` says, unless it is given.
    """
    if weights is None:
        weights = (PAPER_WEIGHTS if config.profile == "paper" else FAST_WEIGHTS,)
    asked = config.schedule
    minutes = asked.paper_minutes
    band_width = FAST_BAND_WIDTH if asked.band_width is None else asked.band_width
    if config.profile == "paper":
        band_width = PAPER_PRUNE[minutes] if asked.prune is None else asked.prune
    schedule = Schedule(
        outer_steps=asked.outer_steps or FAST_OUTER_STEPS,
        inner_steps=asked.inner_steps or FAST_INNER_STEPS,
        epochs=asked.epochs or PAPER_EPOCHS[minutes],
        iterations=asked.iterations,
        batch_fraction=asked.batch_fraction,
        learning_rate=asked.learning_rate,
        band_width=band_width,
    )
    merged = tuple(_merged(each, config.weights) for each in weights)
    keeps = search != "leave_one_out" and config.profile == "fast"
    searched: Search = search if config.weights.viscosity is None else "none"
    return Settings(config, merged, schedule, searched, keeps)


def _merged(defaults: Weights, asked: LossWeights) -> Weights:
    """``defaults`` with the values of ``asked`` that are not None."""
    return replace(defaults, **{k: v for k, v in vars(asked).items() if v is not None})
