"""λv of a dense scan is the one with which points that were held out are missed least."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from runs import Pace

from visco_core import held_out
from visco_core.energy import Energy, nothing_carried, spread
from visco_core.frame import Normalisation
from visco_core.gallery import SHAPES, Shape, uniform_scan
from visco_core.grid.samples import Samples, corner_weights, locate
from visco_core.grid.topology import Grid, dense_grid, refine
from visco_core.held_out import FARTHEST, FINER, HeldOut, choose_factor, hold_out
from visco_core.initial import starting_values
from visco_core.kernels import Array, Backend
from visco_core.multires import SEARCHING
from visco_core.pointcloud import PointCloud
from visco_core.presets import FAST_WEIGHTS
from visco_core.reconstruction import reconstruct
from visco_core.solvers.gauss_newton import GaussNewton
from visco_core.solvers.loop import minimise

VOXELS = 32
NOTHING = PointCloud(np.empty((0, 3)))


def parted(
    count: int, dropped: PointCloud = NOTHING, fitted: bool = True
) -> tuple[np.ndarray, HeldOut]:
    """Points told by their x, and the same parted."""
    points = np.zeros((count, 3))
    points[:, 0] = np.arange(count)
    normals = np.full((count, 3), 0.5, np.float32)
    given = points, normals, normals if fitted else None
    return points, hold_out(*given, dropped, deviation=0.0, level=1, seed=0)


def test_every_point_is_either_seen_or_held_out() -> None:
    points, held = parted(20_000)
    seen, fitted = held.seen
    assert fitted is not None
    assert len(fitted) == len(seen)
    assert len(held.points) == len(held.normals) == pytest.approx(1000, abs=100)
    together = np.sort(np.concatenate([seen, held.points])[:, 0])
    np.testing.assert_array_equal(together, points[:, 0])
    assert parted(20_000, fitted=False)[1].seen[1] is None


def test_of_a_small_scan_more_are_held_out_but_no_more_than_a_tenth() -> None:
    assert len(parted(7000)[1].points) == pytest.approx(500, abs=70)
    assert len(parted(2000)[1].points) == pytest.approx(200, abs=45)


def test_of_a_large_scan_no_more_are_held_out_than_are_needed() -> None:
    assert len(parted(2_000_000)[1].points) == pytest.approx(held_out.MOST, rel=0.03)


def test_what_cleaning_dropped_is_held_out_in_proportion_if_it_has_normals() -> None:
    places = np.full((4000, 3), -1.0)
    with_normals = parted(20_000, PointCloud(places, np.ones((4000, 3), np.float32)))[1]
    assert (with_normals.points[:, 0] < 0).sum() == pytest.approx(200, abs=50)
    assert len(with_normals.points) == len(with_normals.normals)
    assert (with_normals.seen[0] >= 0).all()
    assert (parted(20_000, PointCloud(places))[1].points >= 0).all()


def test_corner_weights_give_a_trilinear_fields_value_and_slopes() -> None:
    rng = np.random.default_rng(1)
    local, corner = rng.random((50, 3)), rng.random((2, 2, 2))

    def value(at: np.ndarray) -> np.ndarray:
        x, y, z = at.T
        low, high = ((1 - z) * c[..., 0, None] + z * c[..., 1, None] for c in corner)
        low, high = ((1 - y) * c[0] + y * c[1] for c in (low, high))
        return (1 - x) * low + x * high

    weights, slopes = corner_weights(local)
    np.testing.assert_allclose(weights @ corner.ravel(), value(local))
    for axis, step in enumerate(1e-6 * np.eye(3)):
        expected = (value(local + step) - value(local - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, axis] @ corner.ravel(), expected, atol=1e-8)


def test_noisy_points_of_a_sphere_lie_outside_of_it_by_what_the_shift_takes_off(
    backend: Backend,
) -> None:
    """By σ² times the mean curvature; a flatter f with the same surface has the same distances."""
    radius, deviation, count = 0.3, 0.02, 200_000
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    exact = 0.5 + radius * normals
    noisy = exact + deviation * rng.normal(size=(count, 3))
    grid = dense_grid(backend, VOXELS + 1)
    nodes = backend.numpy(grid.ijk) / VOXELS - 0.5
    distance = np.append(np.linalg.norm(nodes, axis=1) - radius, 0).astype(np.float32)
    field = backend.array(distance)
    shift = spread(grid, field, deviation * VOXELS) - field

    def mean(points: np.ndarray, field: Array, shift: Array) -> float:
        samples = locate(grid, points, normals.astype(np.float32))
        return float(held_out._distances(grid, field, shift, samples).mean())

    bias, error = deviation**2 / radius, deviation / count**0.5
    trilinear = mean(exact, field, 0 * shift)
    assert mean(noisy, field, 0 * shift) - trilinear == pytest.approx(bias, abs=4 * error)
    corrected = mean(noisy, field, shift)
    assert corrected - trilinear == pytest.approx(0, abs=4 * error)
    assert mean(noisy, field / 2, shift) == pytest.approx(corrected, abs=error)


def least(less: float, more: float, scatter: float = 0.0, count: int = 10_000) -> float:
    wave = scatter * (-1.0) ** np.arange(count)
    return held_out._least(less + wave, more + wave)


def test_the_least_of_a_parabola_is_found_within_an_octave() -> None:
    assert least(3.0, 3.0) == pytest.approx(FINER)
    # 4 (x + 1/2)²: its least lies half an octave down.
    assert least(-1.0 + 1e-9, 8.0) == pytest.approx(FINER - 0.5 - 0.0625, abs=0.1)
    assert least(2.5, 0.0) == FARTHEST
    assert least(-5.0, 6.0) == -FARTHEST
    assert least(-1.0, -2.0) == FARTHEST
    assert least(-2.0, -1.0) == -FARTHEST


def test_differences_within_their_errors_leave_the_viscosity_where_it_is() -> None:
    assert abs(least(0.001, 0.0, scatter=100.0)) < 0.02


class Scan:
    """A noisy torus in the cube, and the level that λv is looked for on."""

    def __init__(self, backend: Backend, count: int = 20_000) -> None:
        cloud = uniform_scan(SHAPES["torus"](), count, noise=0.002, seed=2)
        assert cloud.normals is not None
        frame = Normalisation.of(cloud.points)
        points = frame.to_cube(cloud.points)
        extent = float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
        given = points, cloud.normals, cloud.normals, NOTHING
        self.held = hold_out(*given, 0.002 * extent / frame.scale, level=0, seed=0)
        self.grid = dense_grid(backend, VOXELS + 1)
        begin = starting_values(backend, points, cloud.normals, VOXELS)
        self.begin, self.samples = backend.array(begin), locate(self.grid, points, cloud.normals)
        self.seen = locate(self.grid, *self.held.seen)

    def choose(self, viscosity: float, pace: Pace | None = None) -> float:
        energy = Energy(self.grid, self.seen, replace(FAST_WEIGHTS, viscosity=viscosity))
        solver = GaussNewton(3, 40)
        factor, values = choose_factor(energy, self.begin, solver, pace or Pace(), self.held)
        nearest = energy.with_viscosity(weight=viscosity * 2.0 ** round(np.log2(factor)))
        begun = minimise(solver, nearest, self.begin, Pace(), lambda _: None).values
        if pace is None:
            np.testing.assert_array_equal(values, begun)
        return factor


def test_too_little_becomes_more_and_too_much_less(backend: Backend) -> None:
    scan = Scan(backend)
    assert scan.choose(1e-6) > 1.2
    assert scan.choose(10.0) == pytest.approx(0.25, rel=0.2)


@pytest.mark.parametrize(
    ("told", "sure", "expected"),
    [
        ([-1.0, -0.5], 3.0, -1.5),
        ([-1.0, 0.5], 3.0, -1.0),
        ([-1.0, -1.0, -0.25], 3.0, -2.25),
        ([-1.0, -1.0, -1.0], 3.0, -3.0),
        ([-1.0], np.inf, -1.0),
        ([1.0], 3.0, 1.0),
    ],
    ids=str,
)
def test_from_half_it_goes_on_downwards_while_that_is_surely_better(
    told: list[float],
    sure: float,
    expected: float,
    native_backend: Backend,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of far too much; each time as far as the next parabola says, within what the level allows."""
    answers = iter(np.repeat(told, 2))
    monkeypatch.setattr(held_out, "_least", lambda *_: next(answers))
    monkeypatch.setattr(held_out, "SURE", sure)
    monkeypatch.setattr(held_out, "COARSEST_DOWN", 3)
    assert Scan(native_backend).choose(10.0) == pytest.approx(2**expected)
    assert not list(answers)


def test_few_points_and_a_late_search_change_nothing(native_backend: Backend) -> None:
    assert Scan(native_backend, 1000).choose(1e-6) == 1
    for patience in range(0, 120, 20):
        assert Scan(native_backend).choose(1e-6, Pace(patience=patience)) == 1


def test_a_walk_downwards_that_comes_late_ends_where_it_was(native_backend: Backend) -> None:
    scan, pace = Scan(native_backend), Pace()
    assert scan.choose(10.0, pace) == pytest.approx(0.25, rel=0.2)
    assert scan.choose(10.0, Pace(patience=pace.questions - 1)) == 0.5


def test_on_a_band_the_walk_goes_farther_down_than_on_the_coarsest_level(
    native_backend: Backend,
) -> None:
    scan = Scan(native_backend)
    scan.grid, scan.begin, _ = refine(scan.grid, scan.begin, nothing_carried(scan.grid), 4.0)
    scan.seen = locate(scan.grid, *scan.held.seen)
    assert scan.choose(10.0) < 2**-2.5


def test_what_noise_does_beside_a_bent_surface_is_taken_off_the_same_for_every_viscosity(
    native_backend: Backend, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan, measured, asked = Scan(native_backend), held_out._distances, []

    def watched(grid: Grid, values: Array, shift: Array, samples: Samples) -> np.ndarray:
        asked.append((values, shift))
        return measured(grid, values, shift, samples)

    monkeypatch.setattr(held_out, "_distances", watched)
    scan.choose(1e-4)
    values = asked[0][0]
    expected = spread(scan.grid, values, scan.held.deviation * VOXELS) - values
    assert np.abs(expected).max() > 1e-4
    for _, shift in asked:
        np.testing.assert_allclose(shift, expected, atol=1e-7)


def test_points_far_off_the_surface_have_no_say(native_backend: Backend) -> None:
    scan = Scan(native_backend)
    alone = scan.choose(1e-6)
    stray = np.random.default_rng(3).random((30, 3))
    normals = np.ones((30, 3), np.float32) / np.sqrt(3)
    points = np.concatenate([scan.held.points, stray])
    scan.held = replace(
        scan.held, points=points, normals=np.concatenate([scan.held.normals, normals])
    )
    assert scan.choose(1e-6) == pytest.approx(alone, rel=0.05)


@pytest.mark.parametrize(
    ("creased", "size", "expected"),
    [(0.0, 1.0, 1.4), (0.05, 1.0, 1.0), (0.3, 1.0, 0.8), (0.05, 0.005, 0.8)],
    ids=["smooth", "a few creases", "mostly creases", "creases far below a voxel"],
)
def test_a_few_points_that_bending_moves_far_have_no_say(
    creased: float,
    size: float,
    expected: float,
    native_backend: Backend,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where λv rounds a crease less of it is better; on smooth parts there is just enough."""
    rng = np.random.default_rng(0)
    noise, sign = np.repeat(rng.normal(size=5000), 2), np.tile([-0.1, 0.1], 5000)
    crease = rng.random(10_000) < creased
    octaves = iter((0, -1, 1, -2, -3))

    def missed(*_: object) -> np.ndarray:
        octave = next(octaves)
        smooth = noise + sign * octave
        return size * 0.3 / VOXELS * np.where(crease, 5 * 2.0**octave, smooth)

    monkeypatch.setattr(held_out, "_distances", missed)
    assert Scan(native_backend).choose(1e-4) == pytest.approx(expected, rel=0.1)


def test_the_coarsest_level_forgets_the_points_held_out(native_backend: Backend) -> None:
    """Most of what they make of the surface, beside a solution that never knew them."""
    scan = Scan(native_backend)
    energy = Energy(scan.grid, scan.seen, FAST_WEIGHTS)
    solver = GaussNewton(3, 40)

    def solve(begin: np.ndarray, of: Energy) -> np.ndarray:
        return minimise(solver, of, begin, Pace(), lambda _: None).values

    without = solve(scan.begin, energy)
    of_all = solve(scan.begin, Energy(scan.grid, scan.samples, FAST_WEIGHTS))
    near = np.abs(of_all) < 1 / VOXELS
    forgot = minimise(SEARCHING[0], energy, of_all, Pace(), lambda _: None).values
    left = np.abs(forgot - without)[near].mean() / np.abs(of_all - without)[near].mean()
    assert left < 0.3


@pytest.mark.parametrize(
    ("name", "noise"), [("bumpy_torus", 0.001), ("torus", 0.002), ("bumpy_torus", 0.01)]
)
def test_a_dense_scan_comes_closer_to_the_surface(
    name: str, noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """These are scans of which the law expects more bending than there is, or less."""
    shape: Shape = SHAPES[name]()
    cloud = uniform_scan(shape, 50_000, noise=noise, normal_noise=9)

    def run() -> tuple[float, dict[str, object]]:
        found = reconstruct(cloud)
        return float(np.abs(shape.sdf(found.mesh.vertices)).mean()), found.report["settings"]

    chosen, told = run()
    assert told["viscosity_search"] == "held_out"
    monkeypatch.setattr("visco_core.reconstruction.viscosity_search", lambda *_, **__: "none")
    assert chosen < 0.97 * run()[0]
