"""λv of a sparse scan is the one with which left out points are missed least."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from runs import Pace

from visco_core.config import LossWeights, ReconstructionConfig
from visco_core.energy import Energy
from visco_core.frame import Normalisation
from visco_core.gallery import SHAPES, uniform_scan
from visco_core.grid.samples import locate
from visco_core.grid.topology import dense_grid
from visco_core.initial import starting_values
from visco_core.kernels import Backend
from visco_core.leave_one_out import STEP, _missed, _probe, choose_viscosity
from visco_core.noise import Noise
from visco_core.pointcloud import PointCloud
from visco_core.presets import FAST_WEIGHTS, GREATEST_VISCOSITY, decide, viscosity_search
from visco_core.reconstruction import reconstruct
from visco_core.solvers.gauss_newton import GaussNewton, GaussNewtonState
from visco_core.solvers.loop import minimise

Missed = Callable[[float], float]
VOXELS = 32
SOLVER = GaussNewton(3, 40)


class Scan:
    """A noisy torus in the cube, of 1,000 points of which some may be left out."""

    def __init__(self, backend: Backend) -> None:
        cloud = uniform_scan(SHAPES["torus"](), 1000, noise=0.001, seed=2)
        assert cloud.normals is not None
        self.points = Normalisation.of(cloud.points).to_cube(cloud.points)
        self.normals = cloud.normals
        self.grid = dense_grid(backend, VOXELS + 1)
        self.begin = backend.array(starting_values(backend, self.points, self.normals, VOXELS))

    def energy(self, viscosity: float, chosen: np.ndarray | slice = slice(None)) -> Energy:
        weights = replace(FAST_WEIGHTS, viscosity=viscosity, normal=0.0)
        samples = locate(self.grid, self.points[chosen], self.normals[chosen])
        return Energy(self.grid, samples, weights)

    def solve(self, energy: Energy) -> GaussNewtonState:
        return minimise(SOLVER, energy, self.begin, Pace(), lambda _: None)

    def missed(self, viscosity: float) -> float:
        """By how much each twentieth of the points is missed by the surface of the others."""
        part = np.random.default_rng(0).permutation(len(self.points)) % 20
        square = 0.0
        for left_out in range(20):
            state = self.solve(self.energy(viscosity, part != left_out))
            at_those = self.energy(viscosity, part == left_out).linearise(state.values)
            square += at_those.losses["point"] / FAST_WEIGHTS.point / 20
        return square**0.5

    def choose(self, viscosity: float, pace: Pace | None = None) -> float:
        energy = self.energy(viscosity)
        state = self.solve(energy)
        found, _ = choose_viscosity(energy, self.begin, state, SOLVER, pace or Pace(), 0)
        return found


@pytest.fixture(scope="module")
def scan(native_backend: Backend) -> Scan:
    return Scan(native_backend)


def foretold(scan: Scan, viscosity: float) -> float:
    energy = scan.energy(viscosity)
    return _missed(energy, scan.solve(energy).at, _probe(energy, 0), Pace()).mean() ** 0.5


def test_the_error_is_that_of_points_that_were_really_left_out(scan: Scan) -> None:
    tried = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
    found = [foretold(scan, viscosity) for viscosity in tried]
    missed = [scan.missed(viscosity) for viscosity in tried]
    np.testing.assert_allclose(found, missed, rtol=0.25)
    assert np.argsort(found).tolist() == np.argsort(missed).tolist()


@pytest.mark.parametrize("begin", [1e-4, 1e-3, 3e-2])
def test_the_search_ends_where_neither_neighbour_is_better(begin: float, scan: Scan) -> None:
    found = scan.choose(begin)
    here = foretold(scan, found)
    for other in (found / STEP, found * STEP):
        assert foretold(scan, other) > 0.97 * here
    assert found <= GREATEST_VISCOSITY


@pytest.mark.parametrize(
    ("begin", "bound", "value"),
    [(1e-4, "GREATEST_VISCOSITY", 5e-4), (1e-2, "LEAST_VISCOSITY", 5e-3)],
)
def test_the_search_stays_within_its_bounds(
    begin: float, bound: str, value: float, scan: Scan, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without them it ends at 3e-3 from either side."""
    monkeypatch.setattr(f"visco_core.leave_one_out.{bound}", value)
    assert scan.choose(begin) == value


@pytest.mark.parametrize(
    ("many", "few", "expected"),
    [
        (lambda at: 1e-4 / at, lambda at: 1e-4 / at, GREATEST_VISCOSITY),
        # Below what trilinear voxels make of exact points; and points at creases.
        (lambda at: 1e-7 / at, lambda at: 1e-7 / at, 1e-3),
        (lambda at: 1e-4 / at, lambda at: 1e4 * at, GREATEST_VISCOSITY),
    ],
)
def test_what_tells_nothing_of_the_viscosity_does_not_count(
    many: Missed, few: Missed, expected: float, scan: Scan, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missed(energy: Energy, *_: object) -> np.ndarray:
        at = energy.weights.viscosity
        return np.append(np.full(99, many(at)), few(at)) ** 2

    monkeypatch.setattr("visco_core.leave_one_out._missed", missed)
    assert scan.choose(1e-3) == pytest.approx(expected)


def test_a_late_search_keeps_what_it_has(scan: Scan) -> None:
    """Errors whose solves were cut short would all seem small."""
    begin = 3e-3
    here = foretold(scan, begin)
    assert foretold(scan, STEP * begin) > here
    for patience in range(0, 200, 20):
        found = scan.choose(begin, Pace(patience=patience))
        assert foretold(scan, found) <= here


def test_backends_foretell_the_same(native_backend: Backend, reference_backend: Backend) -> None:
    ours, theirs = (foretold(Scan(each), 1e-4) for each in (native_backend, reference_backend))
    assert ours == pytest.approx(theirs, rel=1e-3)


def search(position: float, spacing: float, levels: int = 3, shared: bool = False) -> str:
    noise = Noise(position, 0.1, 0.002, np.inf, spacing)
    return viscosity_search(noise, [64, 128, 256][:levels], shared=shared)


def test_sparse_points_lie_farther_apart_than_voxels_and_noise() -> None:
    assert search(0.001, 0.01) == "leave_one_out"
    assert search(0.0, 0.01, shared=True) == "leave_one_out"
    assert search(0.0, 0.007) == "held_out"
    assert search(0.002, 0.01, levels=2) == "held_out"
    assert search(0.008, 0.003) == "held_out"


def test_where_points_left_out_say_nothing_none_are() -> None:
    assert search(0.0, 0.01, levels=1) == "none"
    assert search(0.002, 0.003, shared=True) == "none"
    assert search(0.0, 0.0) == "none"


def test_a_viscosity_that_the_user_gives_is_not_looked_for() -> None:
    found = decide(ReconstructionConfig(), search="leave_one_out")
    assert found.search == "leave_one_out"
    assert not found.keeps
    assert decide(ReconstructionConfig(), search="held_out").keeps
    given = ReconstructionConfig(weights=LossWeights(viscosity=1e-4))
    assert decide(given, search="leave_one_out").search == "none"
    assert decide(given, search="held_out").search == "none"


def noisy_torus() -> PointCloud:
    return uniform_scan(SHAPES["torus"](), 5000, noise=0.001, normal_noise=9)


def test_the_chosen_viscosity_stands_on_the_finer_levels_and_in_the_report() -> None:
    found = reconstruct(noisy_torus())
    coarse, middle, fine = (w["viscosity"] for w in found.report["settings"]["weights"])
    assert fine == middle > 2 * coarse
    assert found.report["settings"]["viscosity_search"] == "leave_one_out"


def test_a_sparse_scan_comes_closer_to_the_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = SHAPES["bumpy_torus"]()
    cloud = uniform_scan(shape, 2000, noise=0.001, normal_noise=9)

    def error() -> float:
        return float(np.abs(shape.sdf(reconstruct(cloud).mesh.vertices)).mean())

    chosen = error()
    monkeypatch.setattr("visco_core.reconstruction.viscosity_search", lambda *_, **__: "none")
    assert chosen < 0.8 * error()
