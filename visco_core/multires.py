"""Coarse to fine: the level schedule against the clock and the memory limit.

The coarsest level decides topology and holes and has all its nodes; each finer one halves the
spacing on a narrow band around the surface found so far. Before a level begins, its cost is
predicted from its number of nodes and the speed measured so far: it gets a share of the time that
is left, or is not begun, and the finest finished level stands.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from visco_core.clock import Clock
from visco_core.continuation import FARTHEST, continuation, freedom_of, towards
from visco_core.energy import Energy, carry, nothing_carried
from visco_core.errors import ResourceError
from visco_core.grid.samples import Samples, locate
from visco_core.grid.topology import Grid, dense_grid, keep_closed, refine
from visco_core.held_out import HeldOut, choose_factor
from visco_core.initial import starting_values
from visco_core.kernels import Array, Backend
from visco_core.leave_one_out import choose_viscosity
from visco_core.presets import KEPT_OVER, Settings, Weights
from visco_core.progress import Check
from visco_core.result import Outcome
from visco_core.solvers.adam import Adam
from visco_core.solvers.gauss_newton import GaussNewton
from visco_core.solvers.loop import Solver, State, minimise

T = TypeVar("T")

COARSEST, COARSEST_AT_MOST = 64, 96
"""Voxels an axis of the coarsest level. With fewer, thin shapes keep stray pieces; with more, its
dense grid would take most of the time."""

BYTES_PER_NODE = 150
BYTES_PER_POINT = 420
SECONDS_PER_NODE_STEP = 8e-9
SECONDS_PER_POINT = 3e-7
"""Speeds to begin with, until a level has been timed; the second is that of sorting the points into
a level's voxels."""

SETUP_STEPS = 15
FINISH_STEPS = 30
LEAST_STEPS = 15
MULTILEVEL_STEPS, MULTILEVEL_SETUP_STEPS = 2, 120
"""Costs in units of one conjugate-gradient iteration over the level's nodes: beginning a level,
extracting and writing its surface, the least work that makes a level worth beginning, and, with the
multilevel preconditioner that the coarsest level has, an iteration and its beginning."""

SEARCH_COST, FORGETTING = 6, GaussNewton(2, 30)
"""Of λv by points held out: the time needed, over the level's; how the coarsest forgets them."""

GRACE_SECONDS = 1.0
"""How far beyond the budget the coarsest level may end: a late surface is better than none."""


@dataclass(frozen=True)
class Problem:
    """What is to be solved: points (P, 3) in [0, 1]³, normals (P, 3) to start from and to fit.

    With ``held_out`` the second level looks for λv first.
    """

    points: np.ndarray
    start_normals: np.ndarray
    fitted_normals: np.ndarray | None
    settings: Settings
    held_out: HeldOut | None = None

    def weights(self, level: int) -> Weights:
        """Those of the settings; missing normals must not be fitted as if they were zero."""
        weights = _entry(self.settings.weights, level)
        return weights if self.fitted_normals is not None else replace(weights, normal=0.0)


@dataclass(frozen=True)
class SolvedLevel:
    """A level and what it was solved with; the finer ones go on with the same settings."""

    grid: Grid
    values: Array
    samples: Samples
    losses: dict[str, float]
    settings: Settings


def plan_resolutions(resolution: int) -> list[int]:
    """Voxels an axis of each level, doubling; the last is ``resolution``, rounded up to fit.

    It is a third larger at most: 96 is one level, 97 becomes 64 and 128.
    """
    halvings = max(0, math.ceil(math.log2(resolution / COARSEST_AT_MOST)))
    coarsest = max(COARSEST, -(-resolution // 2**halvings))
    return [coarsest << level for level in range(halvings + 1)]


class LevelPlan:
    """Predicts what levels cost and shares the clock among them.

    A level costs seconds per point, and seconds per node-step: nodes times iterations.
    """

    def __init__(self, settings: Settings, clock: Clock, points: int) -> None:
        self.resolutions = plan_resolutions(settings.config.resolution)
        self.settings, self.clock, self.points = settings, clock, points
        self.seconds_per_node_step = SECONDS_PER_NODE_STEP
        self.seconds_per_point = SECONDS_PER_POINT
        self.nodes = [float((self.resolutions[0] + 1) ** 3)]
        self.nodes += [1.1 * self.nodes[0] * 4**level for level in range(len(self.resolutions) - 1)]

    def stages(self, level: int) -> list[tuple[float, Solver[Any]]]:
        """What is run on ``level``, one after the other: ε and a solver."""
        schedule = self.settings.schedule
        epsilon = _entry(self.settings.weights, level).viscosity_epsilon
        if self.settings.config.profile == "paper":
            adam = Adam(
                iterations=_entry(schedule.epochs, level) * schedule.iterations,
                batch_fraction=schedule.batch_fraction,
                learning_rate=schedule.learning_rate,
                seed=self.settings.config.seed + level,
            )
            return [(epsilon, adam)]
        steps = _entry(schedule.outer_steps, level), _entry(schedule.inner_steps, level)
        if level == 0:
            return [*continuation(epsilon, *steps)]
        return [(epsilon, GaussNewton(*steps))]

    def foresee(self, values: np.ndarray, level: int) -> None:
        """Predicts the nodes of the next levels from the values on this one."""
        width = self.settings.schedule.band_width / self.resolutions[level + 1]
        following = 8.0 * np.count_nonzero(np.abs(values[:-1]) < width)
        for later in range(level + 1, len(self.nodes)):
            self.nodes[later] = following * 4 ** (later - level - 1)

    def located(self, seconds: float) -> None:
        """Takes up how long the points took on a level."""
        self.seconds_per_point = seconds / self.points

    def measured(self, level: int, work: int, seconds: float) -> None:
        """Takes up how long ``work`` iterations on ``level`` took."""
        self.seconds_per_node_step = seconds / (self.nodes[level] * self._steps(level, work))

    def _steps(self, level: int, work: int) -> int:
        if level == 0 and self.settings.config.profile == "fast":
            return MULTILEVEL_SETUP_STEPS + work * MULTILEVEL_STEPS
        return SETUP_STEPS + work

    def cost(self, level: int, least: bool = False) -> float:
        """Seconds that ``level`` takes, or with ``least`` those without which it is not begun."""
        work = sum(solver.work for _, solver in self.stages(level))
        work = min(work, LEAST_STEPS) if least else work
        over_nodes = self.nodes[level] * self._steps(level, work) * self.seconds_per_node_step
        return over_nodes + self.points * self.seconds_per_point

    def finish_seconds(self, level: int) -> float:
        return self.nodes[level] * FINISH_STEPS * self.seconds_per_node_step

    def memory_bytes(self, level: int) -> float:
        return 2.5e8 + self.nodes[level] * BYTES_PER_NODE + self.points * BYTES_PER_POINT

    def affordable(self, level: int) -> str | None:
        """Why ``level`` cannot be begun (an outcome code), or None."""
        limit = self.settings.config.budget.memory_bytes
        if limit is not None and self.memory_bytes(level) > limit:
            return "memory_limited"
        needed = self.cost(level, least=True) + self.finish_seconds(level)
        left = self.clock.remaining_seconds + (GRACE_SECONDS if level == 0 else 0.0)
        return "budget_exhausted" if needed > left else None

    def start(self, level: int) -> None:
        """Gives ``level`` its share of the time left, keeping enough for the finer ones' start."""
        last = self._last_reachable(level)
        costs = [self.cost(k) for k in range(level, last + 1)]
        left = self.clock.remaining_seconds - self.finish_seconds(last)
        self.clock.start_slice(max(left * costs[0] / sum(costs), 0.0))
        self.expect(level, costs[0])

    def expect(self, level: int, seconds: float) -> None:
        """Tells the clock what is left: ``seconds`` on this level, then the later ones."""
        last = self._last_reachable(level)
        later = sum(self.cost(k) for k in range(level + 1, last + 1)) + self.finish_seconds(last)
        here = min(seconds, self.clock.slice_seconds)
        self.clock.expect(min(here + later, max(self.clock.remaining_seconds, 0.0)))

    def _last_reachable(self, level: int) -> int:
        last = level
        while last + 1 < len(self.nodes) and self._reachable(level, last + 1):
            last += 1
        return last

    def _reachable(self, level: int, last: int) -> bool:
        least = sum(self.cost(k, least=True) for k in range(level, last + 1))
        return least + self.finish_seconds(last) <= self.clock.remaining_seconds


def _entry(values: tuple[T, ...], level: int) -> T:
    """What ``values``, coarsest level first, say of ``level``; the last stands for all after it."""
    return values[min(level, len(values) - 1)]


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
    _require_coarsest(plan)
    best = _solve_level(plan, 0, None, problem, backend)
    for level in range(1, len(plan.resolutions)):
        plan.foresee(backend.numpy(best.values), level - 1)
        plan.expect(level - 1, 0.0)
        reason = plan.affordable(level)
        if reason:
            return best, _outcome(plan, best.grid.resolution, reason)
        if on_level is not None:
            on_level(best)
        problem = replace(problem, settings=best.settings)
        best = _solve_level(plan, level, best, problem, backend)
    return best, _outcome(plan, best.grid.resolution, None)


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
        samples = locate(grid, problem.points, problem.fitted_normals, clock.check)
        clock.check()
        energy = Energy(grid, samples, weights, carried)
        clock.check()
        plan.located(time.monotonic() - started)
        settings, held = problem.settings, problem.held_out if level == 1 else None
        if held and coarser and clock.slice_seconds >= SEARCH_COST * plan.cost(level):
            factor = _search(plan, coarser, problem, held)
            settings = settings.with_viscosity_times(factor)
            energy = energy.with_viscosity(weight=_entry(settings.weights, level).viscosity)
        reporter, stages = _Reporter(plan, level), plan.stages(level)
        state, values = _solve_stages(energy, begun, stages, clock, reporter)
        plan.measured(level, reporter.work, reporter.seconds)
        if settings.search == "leave_one_out" and level == 1:
            solver, seed = stages[-1][1], settings.config.seed
            viscosity, state = choose_viscosity(energy, begun, state, solver, clock, seed)
            values = state.values
            settings = settings.with_viscosity_times(viscosity / energy.weights.viscosity)
        entry.update(steps=reporter.steps, iterations=reporter.work, **state.losses)
    return SolvedLevel(grid, keep_closed(grid, begun, values), samples, state.losses, settings)


def _search(plan: LevelPlan, coarser: SolvedLevel, problem: Problem, held: HeldOut) -> float:
    """The factor of λv that points tell which neither level has seen; see ``held_out.py``."""
    clock, grid, weights = plan.clock, coarser.grid, problem.weights(1)
    seen = locate(grid, *held.seen, clock.check)
    energy = Energy(grid, seen, problem.weights(0))
    forgotten = minimise(FORGETTING, energy, coarser.values, clock, lambda _: None).values
    begin = replace(coarser, values=forgotten, samples=seen)
    given = plan.resolutions[1], begin, weights, clock.check
    grid, begun, carried = _begin(grid.backend, problem, *given)
    energy = Energy(grid, locate(grid, *held.seen, clock.check), weights, carried)
    return choose_factor(energy, begun, plan.stages(1)[-1][1], clock, held)


def _solve_stages(
    energy: Energy,
    values: Array,
    stages: list[tuple[float, Solver[Any]]],
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


def _require_coarsest(plan: LevelPlan) -> None:
    reason = plan.affordable(0)
    if reason == "memory_limited":
        needed = plan.memory_bytes(0) / 2**20
        raise ResourceError(
            "memory_too_small",
            f"Even the coarsest level needs about {needed:.0f} MiB; raise the memory limit.",
        )
    if reason == "budget_exhausted":
        enough = plan.cost(0, least=True) + plan.finish_seconds(0) + plan.clock.elapsed_seconds
        raise ResourceError(
            "budget_too_short",
            f"The time budget ends before the coarsest level; about {enough + 1:.0f} s would do.",
        )


def _outcome(plan: LevelPlan, reached: int, reason: str | None) -> Outcome:
    asked = plan.resolutions[-1]
    if reason == "budget_exhausted":
        message = (
            f"The time budget ended at {reached} of {asked} voxels; "
            f"a longer budget would reach the finer level."
        )
        return Outcome("budget_exhausted", message, reached)
    if reason == "memory_limited":
        needed = plan.memory_bytes(plan.resolutions.index(reached) + 1) / 2**30
        message = (
            f"The memory limit ended the run at {reached} of {asked} voxels; "
            f"the next level needs about {needed:.1f} GiB."
        )
        return Outcome("memory_limited", message, reached)
    return Outcome("complete", f"Reached the full resolution of {reached} voxels.", reached)
