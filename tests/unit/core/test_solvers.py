"""Both solvers go downhill, to the same place on every backend and with any number of threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from conftest import THREADS
from runs import Pace
from scipy.spatial import KDTree

from visco_core.energy import Energy, nothing_carried
from visco_core.errors import Stopped
from visco_core.extract import extract_isosurface
from visco_core.gallery import sphere, torus, uniform_scan
from visco_core.grid.samples import locate
from visco_core.grid.topology import dense_grid, refine
from visco_core.initial import starting_values
from visco_core.kernels import Array, Backend, native
from visco_core.presets import FAST_WEIGHTS, PAPER_WEIGHTS, Weights
from visco_core.solvers.adam import ITERATIONS_PER_STEP, TINY, Adam
from visco_core.solvers.gauss_newton import LEAST_INNER_STEPS, GaussNewton, GaussNewtonState
from visco_core.solvers.loop import minimise
from visco_core.solvers.preconditioner import Multilevel


@dataclass
class Run:
    """A solver's last state and the losses after each of its steps."""

    state: Any
    losses: list[dict[str, float]] = field(default_factory=list)

    @property
    def totals(self) -> list[float]:
        return [sum(losses.values()) for losses in self.losses]


def scan_in_cube(hole: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) and normals (P, 3) of a scanned torus; with a hole, of a good half of it."""
    cloud = uniform_scan(torus(), 3000, noise=0.002, normal_noise=10)
    cloud = cloud.select(cloud.points[:, 0] < 0.1) if hole else cloud
    assert cloud.normals is not None
    return 0.5 + 0.4 * cloud.points, cloud.normals


def problem(
    backend: Backend, weights: Weights, side: int = 33, hole: bool = False
) -> tuple[Energy, Array]:
    """The energy of the scan on a dense grid and the values to start from."""
    points, normals = scan_in_cube(hole)
    grid = dense_grid(backend, side)
    values = starting_values(backend, points, normals, side - 1)
    return Energy(grid, locate(grid, points, normals), weights), backend.array(values)


def run(solver: Any, energy: Energy, values: Array, pace: Pace | None = None) -> Run:
    losses: list[dict[str, float]] = []
    last = minimise(
        solver, energy, values, pace or Pace(), lambda state: losses.append(dict(state.losses))
    )
    return Run(last, losses)


def on_band(backend: Backend, weights: Weights) -> tuple[Energy, Array]:
    """The same problem on a narrow band around a coarser solution.

    That one is found without coarea: on the symmetric start, rounding would decide which way it
    pulls.
    """
    energy, values = problem(backend, replace(weights, coarea=0.0), 17)
    coarse = run(GaussNewton(2, 10), energy, values).state.values
    grid, fine, _ = refine(energy.grid, coarse, nothing_carried(energy.grid), 4.0)
    return Energy(grid, locate(grid, *scan_in_cube()), weights), fine


@pytest.mark.parametrize("coarea", [0.0, 1e-5])
def test_gauss_newton_never_raises_the_energy(coarea: float, backend: Backend) -> None:
    energy, values = problem(backend, replace(FAST_WEIGHTS, coarea=coarea), 17)
    found = run(GaussNewton(8, 20), energy, values)
    totals = [energy.linearise(values).total, *found.totals]
    assert (np.diff(totals) <= 0).all()
    assert totals[-1] < 0.8 * totals[0]
    assert found.state.at.total == totals[-1]


def test_gauss_newton_goes_downhill_even_from_noise(native_backend: Backend) -> None:
    energy, values = problem(native_backend, FAST_WEIGHTS, 17)
    noise = np.random.default_rng(0).standard_normal(values.shape).astype(np.float32)
    noise[-1] = 0
    totals = [energy.linearise(noise).total, *run(GaussNewton(10, 20), energy, noise).totals]
    assert (np.diff(totals) <= 0).all()
    assert totals[-1] < 0.01 * totals[0]


def test_one_accurate_step_finds_the_minimum_of_a_quadratic_energy(backend: Backend) -> None:
    """Hardly any viscosity leaves the point and normal losses."""
    energy, values = problem(backend, replace(FAST_WEIGHTS, viscosity=1e-12), 17)
    before = backend.numpy(energy.linearise(values).gradient)
    at = run(GaussNewton(1, 300, inner_tolerance=1e-5), energy, values).state.at
    after = backend.numpy(at.gradient)
    assert np.linalg.norm(after) < 1e-2 * np.linalg.norm(before)


def test_gauss_newton_keeps_what_is_fixed(backend: Backend) -> None:
    energy, values = on_band(backend, FAST_WEIGHTS)
    found = run(GaussNewton(2, 20), energy, values)
    fixed = backend.numpy(energy.grid.flags) == 0
    assert 0 < fixed.sum() < len(fixed) - 100
    before, after = backend.numpy(values), backend.numpy(found.state.values)
    np.testing.assert_array_equal(after[fixed], before[fixed])
    assert (after != before).sum() > 0.9 * (~fixed).sum()


def test_gauss_newton_is_done_when_nothing_is_left_to_gain(native_backend: Backend) -> None:
    energy, values = problem(native_backend, FAST_WEIGHTS, 17)
    found = run(GaussNewton(60, 60), energy, values)
    assert found.state.converged
    assert found.state.steps < 60
    again = run(GaussNewton(60, 60), energy, found.state.values)
    assert again.state.steps <= 2
    assert again.state.at.total == pytest.approx(found.state.at.total, rel=1e-4)


def iterations_until(energy: Energy, state: GaussNewtonState, goal: float) -> int:
    """CG iterations of Gauss-Newton steps from ``state`` until the energy is below ``goal``."""
    solver = GaussNewton(20, 300)
    while state.at.total > goal:
        assert not solver.done(state)
        state = solver.step(energy, state, Pace())
    return state.work


def test_the_multilevel_preconditioner_needs_a_third_of_the_iterations_across_a_hole(
    native_backend: Backend,
) -> None:
    weights = replace(FAST_WEIGHTS, viscosity_epsilon=4 * FAST_WEIGHTS.viscosity_epsilon)
    energy, values = problem(native_backend, weights, hole=True)
    multilevel = GaussNewton(1, 1).init(energy, values)
    goal = 1.003 * run(GaussNewton(8, 60), energy, values).totals[-1]
    ours = iterations_until(energy, multilevel, goal)
    theirs = iterations_until(energy, replace(multilevel, coarser=None), goal)
    assert ours < theirs / 3


def test_the_multilevel_correction_is_symmetric_and_positive(backend: Backend) -> None:
    energy, _ = problem(backend, FAST_WEIGHTS, 17)
    coarser = Multilevel(energy)
    rng = np.random.default_rng(0)
    free = backend.numpy(energy.grid.flags) > 0
    u, v = (rng.standard_normal(len(free)).astype(np.float32) * free for _ in range(2))
    corrections = []
    for residual in (u, v):
        z = backend.zeros(*residual.shape)
        product = coarser.correct(backend.array(residual.copy()), z)
        corrections.append(backend.numpy(z))
        assert product == pytest.approx(float(residual @ corrections[-1]), rel=1e-4)
    on_u, on_v = corrections
    assert not on_u[~free].any()
    assert float(u @ on_v) == pytest.approx(float(v @ on_u), rel=1e-3)
    assert u @ on_u > 0


def test_gauss_newton_steps_that_are_late_end_early_and_still_go_downhill(
    backend: Backend,
) -> None:
    energy, values = problem(backend, FAST_WEIGHTS, 17)
    found = run(GaussNewton(5, 50, inner_tolerance=0.0), energy, values, Pace(patience=0))
    assert found.state.steps == 1
    assert found.state.work == LEAST_INNER_STEPS + 1
    assert found.totals[0] < energy.linearise(values).total


@pytest.mark.parametrize("solver", [GaussNewton(3, 10, 0.0, 0.0), Adam(30, 0.1, 1e-3, 0)])
def test_solvers_ask_whether_to_stop_in_every_iteration(
    solver: Any, native_backend: Backend
) -> None:
    energy, values = problem(native_backend, FAST_WEIGHTS, 17)
    pace = Pace()
    found = run(solver, energy, values, pace)
    assert found.state.work == solver.work == 30
    assert pace.checks >= 30


def test_a_solver_that_is_stopped_leaves_at_once(native_backend: Backend) -> None:
    class Stopping(Pace):
        def check(self) -> None:
            super().check()
            if self.checks == 7:
                raise Stopped

    energy, values = problem(native_backend, FAST_WEIGHTS, 17)
    for solver in (GaussNewton(3, 10), Adam(30, 0.1, 1e-3, 0)):
        pace = Stopping()
        with pytest.raises(Stopped):
            run(solver, energy, values, pace)
        assert pace.checks == 7


def test_adam_reduces_the_energy(native_backend: Backend) -> None:
    energy, values = problem(native_backend, PAPER_WEIGHTS, 17)
    found = run(Adam(250, 0.1, 1e-3, seed=0), energy, values)
    assert found.state.steps == len(found.losses) == 3
    assert found.state.work == 250
    assert found.totals[-1] < 0.7 * energy.linearise(values).total


def test_adam_s_first_step_is_the_learning_rate_against_the_gradient(backend: Backend) -> None:
    """Its moments are then the gradient and its square: −lr · g / (|g| + tiny)."""
    energy, values = problem(backend, PAPER_WEIGHTS, 9)
    gradient = backend.numpy(energy.sampled_gradient(values, 0.5, seed=9))
    found = run(Adam(1, 0.5, 1e-3, seed=9), energy, values).state
    moved = backend.numpy(found.values) - backend.numpy(values)
    np.testing.assert_allclose(moved, -1e-3 * gradient / (np.abs(gradient) + TINY), atol=1e-7)
    assert np.abs(moved).max() > 0.99e-3


def test_adam_ends_a_step_early_when_it_is_late(native_backend: Backend) -> None:
    energy, values = problem(native_backend, PAPER_WEIGHTS, 17)
    found = run(Adam(5 * ITERATIONS_PER_STEP, 0.1, 1e-3, 0), energy, values, Pace(patience=4))
    assert found.state.work == 5
    assert found.state.steps == 1


@pytest.fixture
def set_threads() -> Iterator[Callable[[int], None]]:
    yield native.set_threads
    native.set_threads(THREADS["native"])


@pytest.mark.parametrize(
    ("solver", "weights"),
    [
        (GaussNewton(3, 15), replace(FAST_WEIGHTS, coarea=1e-6)),
        (Adam(60, 0.1, 1e-3, seed=4), PAPER_WEIGHTS),
    ],
    ids=["gauss_newton", "adam"],
)
def test_one_and_two_threads_and_a_second_run_agree_bit_for_bit(
    solver: Any,
    weights: Weights,
    native_backend: Backend,
    set_threads: Callable[[int], None],
) -> None:
    found = []
    for threads in (1, 2, 2):
        set_threads(threads)
        energy, values = problem(native_backend, weights)
        found.append(run(solver, energy, values))
    for other in found[1:]:
        np.testing.assert_array_equal(other.state.values, found[0].state.values)
        assert other.losses == found[0].losses


def test_adam_with_another_seed_ends_elsewhere(native_backend: Backend) -> None:
    energy, values = problem(native_backend, PAPER_WEIGHTS, 17)
    first, second = (run(Adam(20, 0.1, 1e-3, seed), energy, values) for seed in (0, 1))
    assert (first.state.values != second.state.values).any()


@pytest.mark.parametrize(
    ("make", "solver", "weights"),
    [
        (problem, GaussNewton(3, 20), FAST_WEIGHTS),
        (on_band, GaussNewton(3, 20), FAST_WEIGHTS),
        (on_band, Adam(20, 0.1, 1e-3, seed=2), PAPER_WEIGHTS),
    ],
)
def test_both_backends_end_on_the_same_surface(
    make: Callable[[Backend, Weights], tuple[Energy, Array]],
    solver: Any,
    weights: Weights,
    native_backend: Backend,
    reference_backend: Backend,
) -> None:
    surfaces, energies = [], []
    for backend in (native_backend, reference_backend):
        energy, values = make(backend, weights)
        found = run(solver, energy, values)
        energies.append(found.totals[-1])
        surfaces.append(extract_isosurface(energy.grid, found.state.values))
    # Where a node's value is all but zero, rounding decides on which of its edges the vertices lie.
    for one, other in (surfaces, surfaces[::-1]):
        apart, _ = KDTree(one.vertices).query(other.vertices)
        assert apart.max() * energy.grid.resolution < 0.05
    assert energies[0] == pytest.approx(energies[1], rel=1e-4)


def test_gauss_newton_puts_an_exact_scan_s_surface_on_its_points(native_backend: Backend) -> None:
    cloud = uniform_scan(sphere(), 4000)
    assert cloud.normals is not None
    points = 0.5 + 0.4 * cloud.points
    grid = dense_grid(native_backend, 33)
    energy = Energy(grid, locate(grid, points, cloud.normals), FAST_WEIGHTS)
    values = starting_values(native_backend, points, cloud.normals, 32)
    surface = extract_isosurface(grid, run(GaussNewton(5, 30), energy, values).state.values)
    radius = np.linalg.norm(surface.vertices - 0.5, axis=1)
    assert np.abs(radius - 0.4).max() * grid.resolution < 0.1
