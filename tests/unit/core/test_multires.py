"""Levels follow one another as planned, or end where time and memory end."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from visco_core.clock import Clock
from visco_core.config import Budget, LevelSchedule, ReconstructionConfig
from visco_core.continuation import CONTINUATION, freedom_of, towards
from visco_core.errors import ResourceError, Stopped
from visco_core.extract import extract_isosurface
from visco_core.gallery import SHAPES, sphere, uniform_scan
from visco_core.grid.samples import locate
from visco_core.grid.topology import dense_grid
from visco_core.kernels import Backend
from visco_core.level_plan import SEARCH_COST, LevelPlan, plan_resolutions
from visco_core.multires import Problem, SolvedLevel, solve_levels
from visco_core.noise import Noise
from visco_core.presets import PAPER_EPOCHS, Settings, decide, weights_for_noise
from visco_core.progress import Progress
from visco_core.solvers.adam import Adam
from visco_core.solvers.gauss_newton import GaussNewton

QUICK = LevelSchedule(outer_steps=(2, 1), inner_steps=(8,), band_width=3.0)
COARSEST_STEPS = 1 + 1 + 2 + 2


def settings(resolution: int = 128, schedule: LevelSchedule = QUICK, **fields: Any) -> Settings:
    """By default two levels, 64 and 128, that are quick to solve."""
    return decide(ReconstructionConfig(resolution=resolution, schedule=schedule, **fields))


def problem(chosen: Settings | None = None, fitted: bool = True) -> Problem:
    cloud = uniform_scan(sphere(), 3000)
    assert cloud.normals is not None
    points = 0.5 + 0.4 * cloud.points
    return Problem(points, cloud.normals, cloud.normals if fitted else None, chosen or settings())


def new_clock(**fields: Any) -> Clock:
    return Clock(time.monotonic(), **fields)


def plan_of(chosen: Settings, clock: Clock | None = None) -> LevelPlan:
    return LevelPlan(chosen, clock or new_clock(), points=3000)


def test_levels_double_from_no_less_than_64_to_no_less_than_asked() -> None:
    for resolution in range(64, 1025):
        levels = plan_resolutions(resolution)
        assert 64 <= levels[0] <= 96
        assert all(fine == 2 * coarse for coarse, fine in pairwise(levels))
        assert resolution <= levels[-1] <= resolution * 4 / 3
        assert levels[0] == 64 or levels[-1] < resolution + 2 ** (len(levels) - 1)


def test_powers_of_two_start_at_64() -> None:
    assert plan_resolutions(64) == [64]
    assert plan_resolutions(97) == [64, 128]
    assert plan_resolutions(1024) == [64, 128, 256, 512, 1024]


class Record:
    """A whole run on two levels with all that it told."""

    def __init__(self, backend: Backend) -> None:
        self.progress: list[Progress] = []
        self.levels: list[SolvedLevel] = []
        self.clock = new_clock(on_progress=self.progress.append)
        self.best, self.outcome = solve_levels(backend, problem(), self.clock, self.levels.append)


@pytest.fixture(scope="module")
def record(native_backend: Backend) -> Record:
    return Record(native_backend)


def test_without_limits_the_asked_resolution_is_reached(record: Record) -> None:
    assert record.outcome.code == "complete"
    assert record.outcome.resolution == record.best.grid.resolution == 128
    assert "128" in record.outcome.message


def test_every_level_but_the_last_is_shown_once(record: Record) -> None:
    assert [level.grid.resolution for level in record.levels] == [64]
    assert record.levels[0].grid.is_dense
    assert not record.best.grid.is_dense


def test_each_level_is_nearer_to_the_sphere(record: Record) -> None:
    """Mean distance of the nodes beside the surface from the true one, in fine voxels."""
    errors = []
    for level in (*record.levels, record.best):
        exact = np.linalg.norm(level.grid.ijk / level.grid.resolution - 0.5, axis=1) - 0.4
        near = np.abs(exact) * level.grid.resolution < 1
        errors.append(128 * np.abs(level.values[:-1] - exact)[near].mean())
    assert errors[1] < errors[0] < 0.2


def test_progress_counts_levels_and_steps_and_never_falls(record: Record) -> None:
    fractions = [progress.fraction for progress in record.progress]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1
    solving = [p for p in record.progress if p.step]
    assert {p.phase for p in solving} == {"solve"}
    levels = [(p.level, p.resolution) for p in solving]
    assert levels == [(1, 64)] * COARSEST_STEPS + [(2, 128)]
    assert [p.step for p in solving] == [*range(1, COARSEST_STEPS + 1), 1]
    assert {(p.levels, p.steps) for p in solving} == {(2, COARSEST_STEPS), (2, 1)}
    assert all(p.remaining_seconds is not None for p in solving)
    assert all(p.losses.keys() == {"point", "normal", "viscosity"} for p in solving)


def test_after_the_first_level_the_time_left_is_by_measured_speed_alone(
    native_backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("visco_core.level_plan.SECONDS_PER_NODE_STEP", 1.0)
    told = Record(native_backend).progress
    refining = next(i for i, progress in enumerate(told) if progress.phase == "refine")
    assert all((progress.remaining_seconds or 1e9) > 1e5 for progress in told[:refining])
    assert all((progress.remaining_seconds or 0.0) < 1e3 for progress in told[refining:])


def test_phases_and_steps_make_the_report(record: Record) -> None:
    phases = [(entry["phase"], entry["resolution"]) for entry in record.clock.phases]
    assert phases == [("start", 64), ("solve", 64), ("refine", 128), ("solve", 128)]
    solved = record.clock.phases[-1]
    assert solved["nodes"] == len(record.best.grid)
    assert solved["steps"] == 1
    assert solved["iterations"] <= 8
    steps = [(entry["resolution"], entry["step"]) for entry in record.clock.steps]
    assert steps == [(64, step) for step in range(1, COARSEST_STEPS + 1)] + [(128, 1)]
    assert solved["point"] == record.best.losses["point"] == record.clock.steps[-1]["point"]


def test_without_fitted_normals_there_is_no_normal_loss(native_backend: Backend) -> None:
    """Else the missing normals would count as zero and flatten the field at every point."""
    best, _ = solve_levels(native_backend, problem(fitted=False), new_clock())
    assert best.losses["normal"] == 0
    exact = np.linalg.norm(best.grid.ijk / best.grid.resolution - 0.5, axis=1) - 0.4
    near = np.abs(exact) * best.grid.resolution < 1
    assert np.abs(best.values[:-1] - exact)[near].mean() * best.grid.resolution < 0.2


def test_fast_stages_continue_in_epsilon_on_the_coarsest_level_only() -> None:
    plan = plan_of(settings())
    epsilon = plan.settings.weights[0].viscosity_epsilon
    steps = [(8, GaussNewton(1, 8)), (4, GaussNewton(1, 8)), (2, GaussNewton(2, 8))]
    assert plan.stages(0) == [(f * epsilon, s) for f, s in (*steps, (1, GaussNewton(2, 8)))]
    assert plan.stages(1) == [(epsilon, GaussNewton(1, 8))]
    assert plan.stages(4) == plan.stages(1)


def test_paper_stages_are_epochs_of_adam_with_a_seed_of_their_own() -> None:
    config = ReconstructionConfig(profile="paper", seed=11)
    plan = plan_of(decide(config))
    epochs = PAPER_EPOCHS[30]
    for level, expected in enumerate([*epochs, epochs[-1]]):
        ((epsilon, solver),) = plan.stages(level)
        assert epsilon == 1e-2
        assert solver == Adam(12800 * expected, 0.1, 1e-3, 11 + level)


def test_foreseen_nodes_are_those_that_refinement_finds(record: Record) -> None:
    plan = plan_of(settings(256))
    plan.nodes[0] = len(record.levels[0].grid)
    plan.foresee(record.levels[0].values, 0)
    assert plan.nodes[1] == pytest.approx(len(record.best.grid), rel=0.25)
    assert plan.nodes[2] == 4 * plan.nodes[1]


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize(("steps", "inner"), [(5, 30), (1, 1)])
def test_predictions_follow_the_measured_speed(level: int, steps: int, inner: int) -> None:
    """However few iterations were measured: beginning a level is not counted as iterations."""
    plan = plan_of(settings(256, LevelSchedule(outer_steps=(steps,), inner_steps=(inner,))))
    before = [plan.cost(k) for k in range(3)]
    work = sum(solver.work for _, solver in plan.stages(level))
    over_points = plan.points * plan.seconds_per_point
    plan.measured(level, work, 10 * (plan.cost(level) - over_points))
    plan.located(10 * over_points)
    assert [plan.cost(k) for k in range(3)] == pytest.approx([10 * cost for cost in before])


@pytest.mark.parametrize("level", [0, 1])
def test_a_level_that_converged_at_once_is_timed_too(level: int) -> None:
    plan = plan_of(settings(256))
    before = plan.cost(2)
    plan.measured(level, work=0, seconds=1e-3)
    assert 0 < plan.cost(2) < before


@pytest.mark.parametrize("profile", ["fast", "paper"])
@pytest.mark.parametrize("few", [1, 3, 40])
def test_the_least_of_a_level_is_never_more_than_all_of_it(profile: Any, few: int) -> None:
    schedule = LevelSchedule(outer_steps=(1,), inner_steps=(few,), epochs=(1,), iterations=few)
    plan = plan_of(settings(1024, schedule, profile=profile))
    for level in range(len(plan.resolutions)):
        assert plan.cost(level, least=True) <= plan.cost(level)


@pytest.mark.parametrize(("level", "searched"), [(0, 0), (1, 1), (1, 2), (2, 2)])
def test_the_viscosity_is_looked_for_with_what_the_levels_leave_of_the_time(
    level: int, searched: int
) -> None:
    chosen = settings(256)
    free = plan_of(chosen)
    levels = sum(free.cost(k) for k in range(level, 3)) + free.finish_seconds(2)
    search = SEARCH_COST[searched] * free.cost(searched)
    enough = plan_of(chosen, new_clock(budget_seconds=levels + search + 1))
    assert enough.start_search(level, searched)
    assert enough.clock.slice_seconds == pytest.approx(search + 1, abs=0.5)
    short = plan_of(chosen, new_clock(budget_seconds=levels + 0.5 * search))
    short.start(level)
    before = short.clock.slice_seconds
    assert not short.start_search(level, searched)
    assert short.clock.slice_seconds == pytest.approx(before, abs=0.5)
    assert free.start_search(level, searched)
    assert free.clock.slice_seconds == np.inf


def test_points_cost_time_on_every_level() -> None:
    few, many = (LevelPlan(settings(256), new_clock(), points) for points in (1000, 2_000_000))
    for level in range(3):
        assert many.cost(level) > few.cost(level) + 0.1
        assert many.cost(level, least=True) > few.cost(level, least=True) + 0.1


def test_the_coarsest_level_may_end_a_little_after_the_budget(native_backend: Backend) -> None:
    """A scan of millions of points may use up a short budget before anything is solved."""
    clock = Clock(time.monotonic() - 30, budget_seconds=30)
    best, outcome = solve_levels(native_backend, problem(), clock)
    assert best.grid.resolution == 64
    assert outcome.code == "budget_exhausted"


def test_a_budget_that_is_over_before_the_coarsest_level_says_what_would_do(
    native_backend: Backend,
) -> None:
    clock = Clock(time.monotonic() - 40, budget_seconds=30)
    with pytest.raises(ResourceError) as caught:
        solve_levels(native_backend, problem(), clock)
    assert caught.value.code == "budget_too_short"
    found = re.search(r"about (\d+) s", caught.value.detail)
    assert found is not None
    assert 40 < int(found[1]) < 60


def test_a_budget_that_ends_during_a_level_gives_that_level(native_backend: Backend) -> None:
    shown: list[SolvedLevel] = []

    def use_up(progress: Progress) -> None:
        if progress.step:
            clock.started_at -= 1000

    clock = new_clock(budget_seconds=1000.0, on_progress=use_up)
    best, outcome = solve_levels(native_backend, problem(), clock, shown.append)
    assert outcome.code == "budget_exhausted"
    assert outcome.resolution == best.grid.resolution == 64
    assert "64 of 128" in outcome.message
    assert shown == []


def test_a_level_whose_time_is_up_takes_one_short_step(native_backend: Backend) -> None:
    """The prediction allows the coarsest level, and then takes longer than it said."""

    def use_up(progress: Progress) -> None:
        if progress.phase == "start":
            clock.started_at -= 1000

    clock = new_clock(budget_seconds=1000.0, on_progress=use_up)
    chosen = settings(schedule=replace(QUICK, inner_steps=(200,)))
    best, outcome = solve_levels(native_backend, problem(chosen), clock)
    assert outcome.code == "budget_exhausted"
    solved = clock.phases[-1]
    assert solved["steps"] <= len(CONTINUATION)
    assert solved["iterations"] <= 20 * len(CONTINUATION)
    assert best.losses["point"] > 0


def test_a_memory_limit_below_the_coarsest_level_is_refused(native_backend: Backend) -> None:
    chosen = settings(budget=Budget(memory_bytes=2**26))
    with pytest.raises(ResourceError) as caught:
        solve_levels(native_backend, problem(chosen), new_clock())
    assert caught.value.code == "memory_too_small"
    assert re.search(r"about \d+ MiB", caught.value.detail)


def test_a_memory_limit_above_the_coarsest_level_gives_what_fits(native_backend: Backend) -> None:
    enough = int(plan_of(settings(1024)).memory_bytes(0)) + 2**20
    chosen = settings(1024, budget=Budget(memory_bytes=enough))
    best, outcome = solve_levels(native_backend, problem(chosen), new_clock())
    assert outcome.code == "memory_limited"
    assert 64 <= outcome.resolution == best.grid.resolution < 1024
    assert f"{outcome.resolution} of 1024" in outcome.message
    assert "GiB" in outcome.message


def stop_at(call: int) -> tuple[Callable[[], bool], list[int]]:
    """A ``should_stop`` that is true from its ``call``-th call on, and the list of its calls."""
    calls: list[int] = []

    def should_stop() -> bool:
        calls.append(1)
        return len(calls) >= call

    return should_stop, calls


@pytest.mark.parametrize("call", [1, 2, 3, 10, 60])
def test_a_stop_request_ends_the_run_at_once(call: int, native_backend: Backend) -> None:
    should_stop, calls = stop_at(call)
    with pytest.raises(Stopped):
        solve_levels(native_backend, problem(), new_clock(should_stop=should_stop))
    assert len(calls) == call


def test_stop_is_asked_for_in_every_iteration(native_backend: Backend) -> None:
    should_stop, calls = stop_at(10**9)
    clock = new_clock(should_stop=should_stop)
    solve_levels(native_backend, problem(), clock)
    iterations = sum(entry.get("iterations", 0) for entry in clock.phases)
    assert iterations > 20
    assert len(calls) > iterations


def test_solutions_straight_in_the_root_of_epsilon_lead_to_their_limit() -> None:
    limit, error = np.float32([0.2, -0.1, 0.0]), np.float32([0.01, -0.02, 0.03])
    before, last = (4.0, limit + 2 * error), (1.0, limit + error)
    free = np.float32([1, 1, 0])
    found = towards(0.0, last, before, free, farthest=1.0)
    assert found == pytest.approx(np.where(free, limit, last[1]))


def test_a_node_of_a_voxel_with_points_is_not_extrapolated_and_one_in_a_hole_is(
    backend: Backend,
) -> None:
    """A dense plane with a hole in its middle; far from it nothing tells of a dense scan."""
    ticks = (np.arange(160) + 0.5) / 160
    plane = np.stack(np.meshgrid(ticks, ticks, [0.503]), -1).reshape(-1, 3)
    plane = plane[np.abs(plane[:, :2] - 0.5).max(1) > 0.08]
    grid = dense_grid(backend, 33)
    samples = locate(grid, plane, None)
    freedom = backend.numpy(freedom_of(grid, samples))
    assert not freedom[np.unique(backend.numpy(samples.corners))].any()
    cube = freedom[:-1].reshape(33, 33, 33)
    assert cube[16, 16, 16] == 1
    assert cube[16, 16, 0] == 0


def test_no_value_is_extrapolated_by_more_than_the_farthest() -> None:
    before, last = (4.0, np.float32([0.5, -0.5])), (1.0, np.float32([0.1, -0.1]))
    found = towards(0.0, last, before, np.ones(2, np.float32), farthest=0.05)
    assert found == pytest.approx([0.05, -0.05])


def test_a_corner_that_no_point_saw_is_sharper_than_at_the_asked_epsilon(
    native_backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The solutions at the last two ε lead to the limit ε → 0, which rounds less."""
    shape = SHAPES["box"]()
    cloud = uniform_scan(shape, 100_000)
    assert cloud.normals is not None
    corner = cloud.points.max(0)
    scale = 0.9 / np.ptp(cloud.points, axis=0).max()
    seen = np.linalg.norm(cloud.points - corner, axis=1) > 0.12 / scale
    points, normals = 0.5 + scale * cloud.points[seen], cloud.normals[seen]
    chosen = decide(
        ReconstructionConfig(resolution=64),
        weights_for_noise(Noise(5e-4, 0.05, 0.0014, np.inf, 0.003), [64]),
    )

    def error() -> float:
        level, _ = solve_levels(
            native_backend, Problem(points, normals, normals, chosen), new_clock()
        )
        vertices = (extract_isosurface(level.grid, level.values).vertices - 0.5) / scale
        unseen = np.linalg.norm(vertices - corner, axis=1) < 0.12 / scale
        return float(np.abs(shape.sdf(vertices[unseen])).mean())

    extrapolated = error()
    monkeypatch.setattr("visco_core.multires.towards", lambda _, last, *others: last[1])
    assert extrapolated < 0.9 * error()
