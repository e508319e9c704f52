"""On which level λv of a dense scan is looked for, and what the levels are solved with."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from runs import config

from visco_core import multires
from visco_core.clock import Clock
from visco_core.config import ReconstructionConfig
from visco_core.energy import Energy
from visco_core.gallery import sphere, uniform_scan
from visco_core.held_out import hold_out, searched_level
from visco_core.kernels import Array, Backend
from visco_core.level_plan import plan_resolutions
from visco_core.multires import Problem, solve_levels
from visco_core.noise import Noise
from visco_core.pointcloud import PointCloud
from visco_core.presets import FAST_WEIGHTS, GREATEST_VISCOSITY, LEAST_VISCOSITY, decide


def noise(position: float = 0.0, spacing: float = 0.0) -> Noise:
    return Noise(position, 0.1, 0.002, np.inf, spacing)


def test_the_viscosity_is_looked_for_on_the_third_level_at_most() -> None:
    assert searched_level(noise(), [64, 128, 256, 512, 1024]) == 2


WEIGHTS = tuple(replace(FAST_WEIGHTS, viscosity=viscosity) for viscosity in (1e-4, 2e-4, 3e-4))


def problem(told: Noise) -> Problem:
    """Three levels of a sphere with some points held out."""
    cloud = uniform_scan(sphere(), 3000)
    assert cloud.normals is not None
    points = 0.5 + 0.4 * cloud.points
    given = points, cloud.normals, cloud.normals
    searched = searched_level(told, plan_resolutions(256))
    parted = hold_out(*given, PointCloud(np.empty((0, 3))), told.position, searched, seed=0)
    return Problem(*given, decide(config(resolution=256), WEIGHTS), parted)


NARROW, WIDE = 0.0078, 0.0079
"""Just less and just more than a voxel of the second level, 1/128."""


@pytest.mark.parametrize(
    ("told", "plenty", "first", "expected"),
    [
        (noise(NARROW / 2, NARROW / 2), True, [3e-4], [1e-4, 2e-4, 9e-4]),
        (noise(NARROW, NARROW), True, [2e-4], [1e-4, 6e-4, 9e-4]),
        (noise(position=WIDE / 2), True, [2e-4], [1e-4, 6e-4, 9e-4]),
        (noise(spacing=WIDE / 2), True, [2e-4], [1e-4, 6e-4, 9e-4]),
        (noise(position=WIDE), True, [1e-4], [3e-4, 6e-4, 9e-4]),
        (noise(spacing=WIDE), True, [1e-4], [3e-4, 6e-4, 9e-4]),
        (noise(), False, [], [1e-4, 2e-4, 3e-4]),
        (noise(position=WIDE), False, [], [1e-4, 2e-4, 3e-4]),
    ],
)
def test_a_level_and_the_finer_ones_are_solved_with_the_factor_and_all_points(
    told: Noise,
    plenty: bool,
    first: list[float],
    expected: list[float],
    native_backend: Backend,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Looked for without the points held out, on the finest level with voxels wide enough.

    For the coarsest and the second the coarsest is first solved without them, for the third the
    level between is; the search begins with that and with what it carries. From the third level on
    the answer's solution is begun with, and takes one step.
    """
    asked: list[tuple[float, int]] = []
    totals: list[int] = []
    begun: list[tuple[float, bool, int, bool]] = []
    without: list[tuple[int, Array]] = []
    answers: list[Array] = []
    refined: list[tuple[Array, tuple[Any, ...]]] = []
    carried: list[Array | None] = []
    solve, minimise, refine = multires._solve_stages, multires.minimise, multires.refine

    def choose(energy: Energy, begin: Array, *others: Any) -> tuple[float, Array]:
        asked.append((energy.weights.viscosity, energy.samples.total))
        source = begin
        if energy.grid.resolution > 64:
            source, (_, values, kept) = refined[-1]
            assert begin is values
            assert carried[-1] is kept
        if energy.grid.resolution < 256:
            assert source is without[0][1]
        answers.append(begin.copy())
        others[1].start_slice(0.0)
        return 3.0, answers[-1]

    def solved(energy: Energy, values: Array, stages: list[Any], *others: Any) -> Any:
        answered = any(values is answer for answer in answers)
        steps = sum(solver.steps for _, solver in stages)
        begun.append((energy.weights.viscosity, answered, steps, others[0].late()))
        return solve(energy, values, stages, *others)

    def minimised(solver: Any, energy: Energy, *others: Any) -> Any:
        state = minimise(solver, energy, *others)
        if energy.samples.total == seen:
            without.append((energy.grid.resolution, state.values))
        return state

    def finer(grid: Any, values: Array, *others: Any) -> Any:
        refined.append((values, refine(grid, values, *others)))
        return refined[-1][1]

    def energy_of(grid: Any, samples: Any, weights: Any, kept: Array | None = None) -> Energy:
        carried.append(kept)
        return Energy(grid, samples, weights, kept)

    monkeypatch.setattr("visco_core.multires.choose_factor", choose)
    monkeypatch.setattr("visco_core.multires.refine", finer)
    monkeypatch.setattr("visco_core.multires.Energy", energy_of)
    monkeypatch.setattr("visco_core.multires._solve_stages", solved)
    monkeypatch.setattr("visco_core.multires.minimise", minimised)
    cost = 0.0 if plenty else np.inf
    monkeypatch.setattr("visco_core.level_plan.SEARCH_COST", (cost,))
    given, clock = problem(told), Clock(time.monotonic(), 100.0)
    assert given.held_out is not None
    every, seen = len(given.points), len(given.points) - len(given.held_out.points)
    level, _ = solve_levels(
        native_backend, given, clock, lambda level: totals.append(level.samples.total)
    )
    assert asked == [(viscosity, seen) for viscosity in first]
    assert [*totals, level.samples.total] == [every, seen if first == [3e-4] else every, every]
    assert [w.viscosity for w in level.settings.weights] == pytest.approx(expected)
    third = first == [3e-4]
    assert [resolution for resolution, _ in without] == [128 if third else 64] * len(first)
    assert [viscosity for viscosity, *_ in begun] == pytest.approx(expected)
    assert [answered for _, answered, *_ in begun] == [False, False, third]
    assert [steps for *_, steps, _ in begun[1:]] == [2, 1 if third else 2]
    assert not any(late for *_, late in begun)


def test_a_factor_stands_from_its_level_on_within_bounds() -> None:
    weights = tuple(replace(FAST_WEIGHTS, viscosity=v) for v in (1e-4, 1e-4, 2e-4))
    chosen = decide(ReconstructionConfig(), weights)

    def scaled(factor: float, level: int) -> list[float]:
        return [w.viscosity for w in chosen.with_viscosity_times(factor, level).weights]

    assert scaled(0.5, level=1) == [1e-4, 5e-5, 1e-4]
    assert scaled(0.5, level=0) == [5e-5, 5e-5, 1e-4]
    assert scaled(1e9, level=1) == [1e-4, 2 * GREATEST_VISCOSITY, 2 * GREATEST_VISCOSITY]
    assert scaled(1e-9, level=2) == [1e-4, 1e-4, LEAST_VISCOSITY]
