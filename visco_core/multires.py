"""Coarse to fine: the level schedule against the clock and the memory limit.

The coarsest level decides topology and holes and has all its nodes; each finer one halves the
spacing on a narrow band around the surface found so far. One that time or memory does not allow is
not begun, and the finest finished level stands.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from visco_core.clock import Clock
from visco_core.continuation import FARTHEST, freedom_of, towards
from visco_core.energy import Energy, carry, nothing_carried
from visco_core.grid.samples import Samples, locate
from visco_core.grid.topology import Grid, dense_grid, keep_closed, refine
from visco_core.held_out import HeldOut, choose_factor
from visco_core.initial import starting_values
from visco_core.kernels import Array, Backend
from visco_core.leave_one_out import choose_viscosity
from visco_core.level_plan import LevelPlan, at_level
from visco_core.presets import KEPT_OVER, Settings, Weights
from visco_core.progress import Check
from visco_core.result import Outcome
from visco_core.solvers.gauss_newton import GaussNewton
from visco_core.solvers.loop import Solver, State, minimise

SEARCHING = tuple(GaussNewton(steps, 30, inner_tolerance=1e-2) for steps in (2, 2, 1))
"""How levels are solved to look for λv, coarsest first; from the third on they begin nearly right.
The first is also how the coarsest level's solution forgets the points held out."""


@dataclass(frozen=True)
class Problem:
    """What is to be solved: points (P, 3) in [0, 1]³, normals (P, 3) to start from and to fit.

    With ``held_out`` λv is looked for on the level that it names, and those between it and the
    coarsest have only the points not held out.
    """

    points: np.ndarray
    start_normals: np.ndarray
    fitted_normals: np.ndarray | None
    settings: Settings
    held_out: HeldOut | None = None

    def weights(self, level: int) -> Weights:
        """Those of the settings; missing normals must not be fitted as if they were zero."""
        weights = at_level(self.settings.weights, level)
        return weights if self.fitted_normals is not None else replace(weights, normal=0.0)

    def known(self, level: int) -> tuple[np.ndarray, np.ndarray | None]:
        """The points, and their fitted normals, that ``level`` is solved with."""
        if self.held_out is not None and 0 < level < self.held_out.level:
            return self.held_out.seen
        return self.points, self.fitted_normals


@dataclass(frozen=True)
class SolvedLevel:
    """A level and what it was solved with; the finer ones go on with the same settings."""

    grid: Grid
    values: Array
    samples: Samples
    losses: dict[str, float]
    settings: Settings


def solve_levels(
    backend: Backend,
    problem: Problem,
    clock: Clock,
    on_level: Callable[[SolvedLevel], None] | None = None,
) -> tuple[SolvedLevel, Outcome]:
    """The finest level that time and memory allow.

    Raises ResourceError (``memory_too_small``, ``budget_too_short``) when not even the coarsest
    fits, and Stopped.
    """
    plan = LevelPlan(problem.settings, clock, len(problem.points))
    plan.require_coarsest()
    best = _solve_level(plan, 0, None, problem, backend)
    for level in range(1, len(plan.resolutions)):
        plan.foresee(backend.numpy(best.values), level - 1)
        plan.expect(level - 1, 0.0)
        reason = plan.affordable(level)
        if reason:
            return best, plan.outcome(best.grid.resolution, reason)
        if on_level is not None:
            on_level(best)
        problem, held = replace(problem, settings=best.settings), problem.held_out
        if held and 0 < level < held.level and not plan.start_search(level, held.level):
            problem = replace(problem, held_out=None)
        best = _solve_level(plan, level, best, problem, backend)
    return best, plan.outcome(best.grid.resolution, None)


def _begin(
    backend: Backend,
    problem: Problem,
    resolution: int,
    coarser: SolvedLevel | None,
    weights: Weights,
    check: Check,
) -> tuple[Grid, Array, Array]:
    """The grid, the values (N + 1,) to begin with, and what is carried (2, N + 1)."""
    if coarser is not None:
        grid, values, settings = coarser.grid, coarser.values, problem.settings
        carried = nothing_carried(grid)
        if settings.keeps:
            radius = KEPT_OVER * weights.viscosity**0.25 * grid.resolution
            solved = grid, coarser.samples, values
            carried = carry(*solved, weights.viscosity_epsilon, radius, check)
        return refine(grid, values, carried, settings.schedule.band_width)
    values = starting_values(backend, problem.points, problem.start_normals, resolution, check)
    grid = dense_grid(backend, resolution + 1)
    return grid, backend.array(values), nothing_carried(grid)


def _solve_level(
    plan: LevelPlan,
    level: int,
    coarser: SolvedLevel | None,
    problem: Problem,
    backend: Backend,
) -> SolvedLevel:
    clock, resolution = plan.clock, plan.resolutions[level]
    with clock.phase("refine" if coarser else "start", resolution=resolution) as entry:
        weights = problem.weights(level)
        grid, begun, carried = _begin(backend, problem, resolution, coarser, weights, clock.check)
        entry["nodes"] = plan.nodes[level] = len(grid)
    plan.start(level)
    with clock.phase("solve", resolution=resolution, nodes=len(grid)) as entry:
        started = time.monotonic()
        samples = locate(grid, *problem.known(level), clock.check)
        clock.check()
        energy = Energy(grid, samples, weights, carried)
        clock.check()
        plan.located(time.monotonic() - started)
        settings, held = problem.settings, problem.held_out
        stages: Sequence[tuple[float, Solver[Any]]] = plan.stages(level)
        if held and level == held.level and plan.start_search(level, level):
            begin = grid, begun, carried
            factor, solution = _search(plan, level, coarser, begin, problem, held)
            if level > 1:
                once = GaussNewton(1, at_level(settings.schedule.inner_steps, level))
                begun, stages = solution, [(weights.viscosity_epsilon, once)]
            settings = settings.with_viscosity_times(factor, level)
            energy = energy.with_viscosity(weight=at_level(settings.weights, level).viscosity)
            plan.start(level)
        reporter = _Reporter(plan, level)
        state, values = _solve_stages(energy, begun, stages, clock, reporter)
        plan.measured(level, reporter.work, reporter.seconds)
        if settings.search == "leave_one_out" and level == 1:
            solver, seed = stages[-1][1], settings.config.seed
            viscosity, state = choose_viscosity(energy, begun, state, solver, clock, seed)
            values = state.values
            settings = settings.with_viscosity_times(viscosity / energy.weights.viscosity, level)
        entry.update(steps=reporter.steps, iterations=reporter.work, **state.losses)
    return SolvedLevel(grid, keep_closed(grid, begun, values), samples, state.losses, settings)


def _search(
    plan: LevelPlan,
    level: int,
    coarser: SolvedLevel | None,
    begin: tuple[Grid, Array, Array],
    problem: Problem,
    held: HeldOut,
) -> tuple[float, Array]:
    """The factor of λv that points held out tell, and a solution near it; see ``held_out.py``.

    ``begin`` is what ``_begin`` gave. On the third level nothing is left in it of what the coarsest
    has made of the points held out, and the second has not had them.
    """
    clock, weights = plan.clock, problem.weights(level)
    grid, begun, carried = begin
    if level == 1 and coarser is not None:
        given = plan.resolutions[level], _forgetting(coarser, problem, held, clock), weights
        grid, begun, carried = _begin(grid.backend, problem, *given, clock.check)
    energy = Energy(grid, locate(grid, *held.seen, clock.check), weights, carried)
    if level == 0:
        begun = minimise(SEARCHING[0], energy, begun, clock, lambda _: None).values
    return choose_factor(energy, begun, at_level(SEARCHING, level), clock, held)


def _forgetting(
    coarsest: SolvedLevel, problem: Problem, held: HeldOut, clock: Clock
) -> SolvedLevel:
    """``coarsest`` less what the points held out have told it."""
    seen = locate(coarsest.grid, *held.seen, clock.check)
    energy = Energy(coarsest.grid, seen, problem.weights(0))
    values = minimise(SEARCHING[0], energy, coarsest.values, clock, lambda _: None).values
    return replace(coarsest, values=values, samples=seen)


def _solve_stages(
    energy: Energy,
    values: Array,
    stages: Sequence[tuple[float, Solver[Any]]],
    clock: Clock,
    reporter: _Reporter,
) -> tuple[Any, Array]:
    """The last stage's state, and the values (N + 1,) that the stages lead to.

    Of one stage these are its own; of several, those at ε → 0.
    """
    farthest = FARTHEST / energy.grid.resolution
    freedom = freedom_of(energy.grid, energy.samples) if len(stages) > 1 else None
    following = [epsilon for epsilon, _ in stages[1:]] + [0.0]
    states: list[Any] = []
    before: tuple[float, Array] | None = None
    for (epsilon, solver), after in zip(stages, following, strict=True):
        within = energy.with_viscosity(epsilon=epsilon)
        states.append(minimise(solver, within, values, clock, reporter.tell))
        reporter.end_stage(states[-1])
        values = states[-1].values
        solved = epsilon, values
        if before is not None:
            values = towards(after, solved, before, freedom, farthest)
        before = solved
    return states[-1], values


class _Reporter:
    """Counts the steps of a level over its stages and tells the clock of each."""

    def __init__(self, plan: LevelPlan, level: int) -> None:
        self._plan, self._clock, self._level = plan, plan.clock, level
        self._resolution, self._levels = plan.resolutions[level], len(plan.resolutions)
        self._planned = sum(solver.steps for _, solver in plan.stages(level))
        self._begun = time.monotonic()
        self.steps = self.work = 0

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._begun

    def tell(self, state: State) -> None:
        step = self.steps + state.steps
        self._plan.expect(self._level, self.seconds * (self._planned / step - 1))
        self._clock.steps.append({"resolution": self._resolution, "step": step, **state.losses})
        self._clock.report(
            "solve",
            level=self._level + 1,
            levels=self._levels,
            resolution=self._resolution,
            step=step,
            steps=self._planned,
            losses=state.losses,
        )

    def end_stage(self, state: State) -> None:
        self.steps += state.steps
        self.work += state.work
