"""What the levels cost, and how the clock and the memory limit are shared among them.

Before a level begins, its cost is predicted from its number of nodes and the speed measured so far:
it gets a share of the time that is left, or is not begun.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np

from visco_core.clock import Clock
from visco_core.continuation import continuation
from visco_core.errors import ResourceError
from visco_core.presets import Settings
from visco_core.result import Outcome
from visco_core.solvers.adam import Adam
from visco_core.solvers.gauss_newton import GaussNewton
from visco_core.solvers.loop import Solver

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

GRACE_SECONDS = 1.0
"""How far beyond the budget the coarsest level may end: a late surface is better than none."""

SEARCH_COST = 1.5, 6.0, 3.0
"""What looking for λv by points held out costs at most, over the level's own cost: on the coarsest
level, on the second and on finer ones."""


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
        epsilon = at_level(self.settings.weights, level).viscosity_epsilon
        if self.settings.config.profile == "paper":
            adam = Adam(
                iterations=at_level(schedule.epochs, level) * schedule.iterations,
                batch_fraction=schedule.batch_fraction,
                learning_rate=schedule.learning_rate,
                seed=self.settings.config.seed + level,
            )
            return [(epsilon, adam)]
        steps = at_level(schedule.outer_steps, level), at_level(schedule.inner_steps, level)
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

    def start_search(self, level: int, searched: int) -> bool:
        """Gives looking for λv on a level what those from ``level`` on leave, if that will do."""
        last = self._last_reachable(level)
        levels = sum(self.cost(k) for k in range(level, last + 1)) + self.finish_seconds(last)
        spare = self.clock.remaining_seconds - levels
        needed = at_level(SEARCH_COST, searched) * self.cost(searched)
        if spare < needed or searched > last:
            return False
        self.clock.start_slice(spare)
        self.expect(level, needed + self.cost(level))
        return True

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

    def require_coarsest(self) -> None:
        """Raises ResourceError when not even the coarsest level is possible."""
        reason = self.affordable(0)
        if reason == "memory_limited":
            needed = self.memory_bytes(0) / 2**20
            raise ResourceError(
                "memory_too_small",
                f"Even the coarsest level needs about {needed:.0f} MiB; raise the memory limit.",
            )
        if reason == "budget_exhausted":
            enough = self.cost(0, least=True) + self.finish_seconds(0) + self.clock.elapsed_seconds
            raise ResourceError(
                "budget_too_short",
                f"The time budget ends before the coarsest level; "
                f"about {enough + 1:.0f} s would do.",
            )

    def outcome(self, reached: int, reason: str | None) -> Outcome:
        """How a run ended that ``reached`` a resolution, and why no finer one."""
        asked = self.resolutions[-1]
        if reason == "budget_exhausted":
            message = (
                f"The time budget ended at {reached} of {asked} voxels; "
                f"a longer budget would reach the finer level."
            )
            return Outcome("budget_exhausted", message, reached)
        if reason == "memory_limited":
            needed = self.memory_bytes(self.resolutions.index(reached) + 1) / 2**30
            message = (
                f"The memory limit ended the run at {reached} of {asked} voxels; "
                f"the next level needs about {needed:.1f} GiB."
            )
            return Outcome("memory_limited", message, reached)
        return Outcome("complete", f"Reached the full resolution of {reached} voxels.", reached)


def at_level(values: tuple[T, ...], level: int) -> T:
    """What ``values``, coarsest level first, say of ``level``; the last stands for all after it."""
    return values[min(level, len(values) - 1)]
