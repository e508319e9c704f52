"""The noise of scans whose noise is known, and the weights that follow from it."""

import numpy as np
import pytest

from visco_core.gallery import SHAPES, flip_normals, thin_plate, uniform_scan
from visco_core.noise import Noise, estimate_noise
from visco_core.presets import FIRMEST_VISCOSITY, SHARED_NORMAL_ERROR, weights_for_noise


@pytest.mark.parametrize(("points", "noise"), [(20_000, 0.002), (50_000, 0.001), (50_000, 0.01)])
def test_noise_is_found_to_a_third_at_any_density(points: int, noise: float) -> None:
    shape = SHAPES["bumpy_torus"]()
    cloud = uniform_scan(shape, points, noise=noise, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert found.position == pytest.approx(noise * shape.diagonal, rel=0.33)


def test_an_exact_scan_has_noise_far_below_its_point_spacing() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 20_000, seed=1)
    spacing = np.sqrt(4 * np.pi / 20_000) * SHAPES["sphere"]().diagonal / (2 * np.sqrt(3))
    assert estimate_noise(cloud.points, cloud.normals).position < 0.05 * spacing


def test_deviation_of_normals_is_found() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 20_000, normal_noise=20, seed=1)
    found = estimate_noise(cloud.points, cloud.normals).normal
    tilt = np.arccos(np.clip(np.sum(cloud.normals * _exact(cloud.points), 1), -1, 1))
    assert found == pytest.approx(np.sqrt(np.square(np.sin(tilt)).mean()), rel=0.25)


def test_the_other_face_of_a_thin_wall_is_no_noise() -> None:
    plate = thin_plate(0.015)
    cloud = uniform_scan(plate, 50_000, noise=0.0003, normal_noise=8, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert found.position == pytest.approx(0.0003 * plate.diagonal, rel=0.2)
    assert found.normal == pytest.approx(np.radians(8), rel=0.2)


def test_normals_that_face_the_wrong_way_are_noise() -> None:
    cloud = flip_normals(uniform_scan(SHAPES["sphere"](), 20_000, noise=0.002, seed=1), 0.3)
    found = estimate_noise(cloud.points, cloud.normals)
    assert found.normal == pytest.approx(np.sqrt(4 * 0.3 * 0.7), rel=0.1)
    assert found.position == pytest.approx(0.002 * SHAPES["sphere"]().diagonal, rel=0.1)


def test_estimate_scales_with_the_units_of_the_scan() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 5_000, noise=0.003, seed=1)
    small = estimate_noise(cloud.points, cloud.normals)
    large = estimate_noise(cloud.points * 1000, cloud.normals)
    assert large.position == pytest.approx(1000 * small.position)


def test_the_same_seed_gives_the_same_estimate() -> None:
    cloud = uniform_scan(SHAPES["torus"](), 5_000, noise=0.003, seed=1)
    first, second = (estimate_noise(cloud.points, cloud.normals, seed=4) for _ in range(2))
    assert first == second


def test_few_points_are_enough_for_an_estimate() -> None:
    cloud = uniform_scan(SHAPES["sphere"](), 10, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert np.isfinite([found.position, found.normal]).all()


def test_smoothing_grows_with_the_variance_and_falls_with_the_number_of_points() -> None:
    few = weights_for_noise(Noise(0.01, 0.3), 1_000_000, [64, 256])[-1]
    many = weights_for_noise(Noise(0.01, 0.3), 10_000_000, [64, 256])[-1]
    clean = weights_for_noise(Noise(0.001, 0.3), 10_000_000, [64, 1024])[-1]
    assert few.viscosity == pytest.approx(10 * many.viscosity, rel=0.05)
    assert many.viscosity == pytest.approx(100 * clean.viscosity, rel=0.05)


def test_few_and_noisy_points_leave_the_shape_its_detail() -> None:
    """λv in proportion to σ²/m was three times the best for 5,000 points at 1 % noise."""
    weights = weights_for_noise(Noise(0.009, 0.6), 5000, [64, 128, 256])
    noisier = weights_for_noise(Noise(0.018, 0.6), 5000, [64, 128, 256])
    for each, other in zip(weights, noisier, strict=True):
        assert 1e-3 < each.viscosity < other.viscosity < FIRMEST_VISCOSITY


def test_normals_weigh_against_points_as_their_variances_say() -> None:
    weights = weights_for_noise(Noise(0.01, 0.2), 10_000, [1024])[-1]
    variance = 0.2**2 + SHARED_NORMAL_ERROR**2
    assert weights.normal / weights.point == pytest.approx(0.01**2 / variance, rel=1e-3)


def test_normals_made_from_the_points_count_on_the_coarsest_level_alone() -> None:
    noise, resolutions = Noise(0.001, 0.2), [64, 128, 256]
    given = weights_for_noise(noise, 100_000, resolutions)
    made = weights_for_noise(noise, 100_000, resolutions, derived=True)
    assert [weights.normal for weights in made] == [given[0].normal, 0, 0]
    assert [weights.viscosity for weights in made] == [weights.viscosity for weights in given]


def test_an_exact_scan_still_gets_the_smoothing_of_a_voxel() -> None:
    for weights in weights_for_noise(Noise(0.0, 0.0), 100_000, [64, 128, 256]):
        assert 0 < weights.viscosity < 1e-4
        assert 0 < weights.normal < 1e-3


def test_coarse_voxels_smooth_more_and_trust_normals_more() -> None:
    coarse, middle, fine = weights_for_noise(Noise(0.001, 0.2), 100_000, [64, 128, 256])
    assert coarse.viscosity > middle.viscosity > fine.viscosity
    assert coarse.normal > middle.normal > fine.normal


def _exact(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)
