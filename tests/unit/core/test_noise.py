"""The noise of scans whose noise is known, and the weights that follow from it."""

from dataclasses import replace

import numpy as np
import pytest

from visco_core.frame import Normalisation
from visco_core.gallery import SHAPES, flip_normals, thin_plate, uniform_scan
from visco_core.noise import Noise, estimate_noise
from visco_core.presets import (
    BEND_POWER,
    GREATEST_VISCOSITY,
    LEAST_VISCOSITY,
    NEARER,
    SHARED_IN_HOLES,
    SHARED_NOISE,
    SHARED_NORMAL_ERROR,
    SMOOTHED,
    THIN_WALL,
    VOXEL_ERROR,
    expected_error,
    weights_for_noise,
)


@pytest.mark.parametrize("noise", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("points", [5_000, 50_000, 200_000])
@pytest.mark.parametrize("name", ["bracket", "bumpy_torus"])
def test_noise_is_found_to_a_third_at_any_density(name: str, points: int, noise: float) -> None:
    shape = SHAPES[name]()
    cloud = uniform_scan(shape, points, noise=noise, normal_noise=10, seed=1)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert found.position == pytest.approx(noise * shape.diagonal, rel=0.33)


def test_bumps_as_high_as_the_noise_are_told_from_it() -> None:
    """Their variogram alone is 15 % too large."""
    shape = SHAPES["bumpy_torus"]()
    cloud = uniform_scan(shape, 50_000, noise=0.01, normal_noise=35)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert found.position == pytest.approx(0.01 * shape.diagonal, rel=0.1)


@pytest.mark.parametrize("name", ["bracket", "octopus"])
def test_the_detail_of_a_sparse_scan_is_no_noise(name: str) -> None:
    """What quadrics leave over was taken for noise, up to one half: seven times as much as here."""
    shape = SHAPES[name]()
    cloud = uniform_scan(shape, 5_000, seed=1)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert found.position < 1e-4 * shape.diagonal


@pytest.mark.parametrize("noise", [0.0, 0.0005, 0.002])
def test_bending_is_what_quadrics_through_24_points_miss_whatever_the_noise(noise: float) -> None:
    random = np.random.default_rng(1)
    x, y = random.uniform(-0.5, 0.5, (2, 100_000))
    exact = 0.01 * np.sin(40 * x) * np.sin(40 * y)
    normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
    points = np.stack([x, y, exact + noise * random.standard_normal(len(x))], 1)
    found = estimate_noise(points, normals, SMOOTHED).bending
    missed = []
    for place in np.flatnonzero(np.maximum(abs(x), abs(y)) < 0.5 - SMOOTHED)[:300]:
        u, v = x - x[place], y - y[place]
        near = random.choice(np.flatnonzero(u * u + v * v < SMOOTHED**2), 24, replace=False)
        u, v = u[near], v[near]
        terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
        missed.append(exact[place] - np.linalg.lstsq(terms, exact[near])[0][0])
    assert found == pytest.approx(np.sqrt(np.square(missed).mean()), rel=0.35)


def test_finely_shaped_surfaces_bend_more() -> None:
    torus, octopus = (_in_cube(name, 20_000).bending for name in ("torus", "octopus"))
    assert octopus > 10 * torus > 0


def test_bending_is_the_same_however_many_points_see_it() -> None:
    few, many = (_in_cube("octopus", count, noise=0.001).bending for count in (20_000, 500_000))
    assert many == pytest.approx(few, rel=0.35)


def test_bending_of_few_points_is_what_their_quadrics_leave_over() -> None:
    sphere, octopus = (_in_cube(name, 100).bending for name in ("sphere", "octopus"))
    assert 0 < sphere < 0.3 * octopus


def test_how_far_apart_walls_are_is_found() -> None:
    plate = uniform_scan(thin_plate(0.03), 20_000, noise=0.002, seed=1)
    assert 0.03 < estimate_noise(plate.points, plate.normals, SMOOTHED).wall < 4 * 0.03
    sphere = uniform_scan(SHAPES["sphere"](), 20_000, noise=0.002, seed=1)
    assert estimate_noise(sphere.points, sphere.normals, SMOOTHED).wall > 0.5


def test_the_digits_of_coordinates_are_no_noise() -> None:
    cloud = uniform_scan(SHAPES["box"](), 5_000, seed=1)
    found = estimate_noise(cloud.points.astype(np.float32).astype(float), cloud.normals, SMOOTHED)
    assert found.position == 0


def test_copies_of_points_do_not_hide_the_noise() -> None:
    shape = SHAPES["sphere"]()
    cloud = uniform_scan(shape, 10_000, noise=0.002, seed=1)
    twice = np.repeat(cloud.points, 2, axis=0), np.repeat(cloud.normals, 2, axis=0)
    found = estimate_noise(*twice, SMOOTHED).position
    assert found == pytest.approx(0.002 * shape.diagonal, rel=0.33)


def test_noise_of_points_in_even_rows_is_found() -> None:
    """Their closest pairs are all as far apart, which tells nothing of pairs closer still."""
    x, y = np.meshgrid(np.arange(80.0), np.arange(80.0))
    height = 0.3 * np.random.default_rng(1).standard_normal(x.size) + 0.002 * x.ravel() ** 2
    normals = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    found = estimate_noise(np.stack([x.ravel(), y.ravel(), height], 1), normals, SMOOTHED)
    assert found.position == pytest.approx(0.3, rel=0.15)


def test_an_exact_scan_has_noise_far_below_its_point_spacing() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 20_000, seed=1)
    spacing = np.sqrt(4 * np.pi / 20_000) * SHAPES["sphere"]().diagonal / (2 * np.sqrt(3))
    assert estimate_noise(cloud.points, cloud.normals, SMOOTHED).position < 0.05 * spacing


def test_deviation_of_normals_is_found() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 20_000, normal_noise=20, seed=1)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED).normal
    tilt = np.arccos(np.clip(np.sum(cloud.normals * _exact(cloud.points), 1), -1, 1))
    assert found == pytest.approx(np.sqrt(np.square(np.sin(tilt)).mean()), rel=0.25)


def test_the_other_face_of_a_thin_wall_is_no_noise() -> None:
    plate = thin_plate(0.015)
    cloud = uniform_scan(plate, 50_000, noise=0.0003, normal_noise=8, seed=1)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert found.position == pytest.approx(0.0003 * plate.diagonal, rel=0.2)
    assert found.normal == pytest.approx(np.radians(8), rel=0.2)


def test_normals_that_face_the_wrong_way_are_noise() -> None:
    cloud = flip_normals(uniform_scan(SHAPES["sphere"](), 20_000, noise=0.002, seed=1), 0.3)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert found.normal == pytest.approx(np.sqrt(4 * 0.3 * 0.7), rel=0.1)
    assert found.position == pytest.approx(0.002 * SHAPES["sphere"]().diagonal, rel=0.1)


def test_estimate_scales_with_the_units_of_the_scan() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 5_000, noise=0.003, seed=1)
    small = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    large = estimate_noise(cloud.points * 1000, cloud.normals, 1000 * SMOOTHED)
    assert large.position == pytest.approx(1000 * small.position)
    assert large.bending == pytest.approx(1000 * small.bending)


def test_the_same_seed_gives_the_same_estimate() -> None:
    cloud = uniform_scan(SHAPES["torus"](), 5_000, noise=0.003, seed=1)
    first, second = (
        estimate_noise(cloud.points, cloud.normals, SMOOTHED, seed=4) for _ in range(2)
    )
    assert first == second


def test_few_points_are_enough_for_an_estimate() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 10, seed=1)
    found = estimate_noise(cloud.points, cloud.normals, SMOOTHED)
    assert np.isfinite([found.position, found.normal]).all()


def _viscosity(noise: Noise, resolution: int = 256) -> float:
    return weights_for_noise(noise, [64, resolution])[-1].viscosity


def _noise(position: float = 0.005, bending: float = 0.002, spacing: float = 0.005) -> Noise:
    return Noise(position, 0.3, bending, np.inf, spacing)


def test_smoothing_is_that_with_the_least_error_expected() -> None:
    noise = _noise()
    for weights, resolution in zip(weights_for_noise(noise, [64, 256]), (64, 256), strict=True):
        chosen = weights.viscosity * np.array([1, 0.5, 2])
        errors = expected_error(noise, resolution, chosen)
        assert errors.argmin() == 0
        assert errors.max() < 1.2 * errors.min()


def test_smoothing_grows_with_noise_and_falls_with_bending_and_with_more_points() -> None:
    usual = _viscosity(_noise())
    power = 1 / (BEND_POWER + 1 / 4)
    assert _viscosity(_noise(position=0.01)) == pytest.approx(2**power * usual, rel=0.2)
    assert _viscosity(_noise(bending=0.004)) == pytest.approx(2**-power * usual, rel=0.2)
    assert _viscosity(_noise(spacing=0.0025)) == pytest.approx(2**-power * usual, rel=0.2)


def test_smoothing_keeps_close_walls_apart_and_stays_within_its_bounds() -> None:
    smooth = Noise(0.01, 0.3, 0.0, np.inf, 0.01)
    assert _viscosity(smooth) == pytest.approx(GREATEST_VISCOSITY)
    walls = replace(smooth, wall=0.03)
    assert _viscosity(walls) == pytest.approx((THIN_WALL * (0.03 + 0.01 * NEARER)) ** 4)
    assert _viscosity(Noise(0.0, 0.3, 0.1, np.inf, 1e-4)) == pytest.approx(LEAST_VISCOSITY)


def test_normals_weigh_against_points_as_their_variances_say() -> None:
    levels = weights_for_noise(Noise(0.01, 0.5, 0.1, np.inf, 0.004), [1024, 2048])
    for weights, shared in zip(levels, (SHARED_IN_HOLES, SHARED_NORMAL_ERROR), strict=True):
        variance = 0.5**2 + shared**2
        assert weights.normal / weights.point == pytest.approx(0.01**2 / variance, rel=2e-3)


def test_normals_weigh_more_against_points_whose_noise_hides_the_voxels_error() -> None:
    voxel = (VOXEL_ERROR / 256) ** 2
    for noise, counted in ((0.0, 0.02 * voxel), (2e-4, 2e-4**2), (1e-3, voxel)):
        weights = weights_for_noise(Noise(noise, 0.0, 0.02, np.inf, 0.003), [64, 256])[-1]
        expected = 0.1 * (noise**2 + counted) / SHARED_NORMAL_ERROR**2
        assert weights.normal == pytest.approx(expected)


def test_normals_made_from_the_points_count_on_the_coarsest_level_alone() -> None:
    noise, resolutions = Noise(0.001, 0.2, 0.02, np.inf, 0.003), [64, 128, 256]
    given = weights_for_noise(noise, resolutions)
    made = weights_for_noise(noise, resolutions, derived=True)
    assert [weights.normal for weights in made] == [given[0].normal, 0, 0]


def test_noise_that_neighbours_share_is_smoothed_less() -> None:
    noise, resolutions = Noise(0.001, 0.2, 0.002, np.inf, 0.003), [64, 128, 256]
    less = replace(noise, position=SHARED_NOISE * noise.position)
    for made, own, counted in zip(
        weights_for_noise(noise, resolutions, shared=True),
        weights_for_noise(noise, resolutions),
        weights_for_noise(less, resolutions),
        strict=True,
    ):
        assert made.viscosity == counted.viscosity < own.viscosity


def test_an_exact_scan_still_gets_the_smoothing_that_voxels_need() -> None:
    coarse, fine = weights_for_noise(Noise(0.0, 0.0, 0.0005, np.inf, 0.003), [64, 256])
    assert coarse.viscosity > 2 * fine.viscosity > 2 * LEAST_VISCOSITY
    assert 0 < fine.normal < 1e-3


def test_exact_points_far_apart_are_smoothed_as_if_they_lay_in_every_voxel() -> None:
    far, near = (weights_for_noise(Noise(0, 0, 5e-4, np.inf, s), [64])[0] for s in (0.1, 1 / 64))
    assert far.viscosity == near.viscosity


def test_coarse_voxels_smooth_more_and_trust_normals_more() -> None:
    noise = Noise(0.0001, 0.2, 0.0005, np.inf, 0.003)
    coarse, middle, fine = weights_for_noise(noise, [64, 128, 256])
    assert coarse.viscosity > middle.viscosity > fine.viscosity
    assert coarse.normal > middle.normal > fine.normal


def _in_cube(name: str, points: int, noise: float = 0.0) -> Noise:
    """Of a scan of the gallery's shape, in units of the cube that holds it."""
    cloud = uniform_scan(SHAPES[name](), points, noise=noise, seed=1)
    placed = Normalisation.of(cloud.points).to_cube(cloud.points)
    return estimate_noise(placed, cloud.normals, SMOOTHED)


def _exact(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)
