"""The noise of scans whose noise is known, and the weights that follow from it."""

import numpy as np
import pytest

from visco_core.gallery import SHAPES, flip_normals, thin_plate, uniform_scan
from visco_core.noise import Noise, estimate_noise
from visco_core.presets import (
    LEAST_VISCOSITY,
    SHARED_NORMAL_ERROR,
    VOXEL_ERROR,
    weights_for_noise,
)


@pytest.mark.parametrize("noise", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("points", [5_000, 50_000, 200_000])
@pytest.mark.parametrize("name", ["bracket", "bumpy_torus"])
def test_noise_is_found_to_a_third_at_any_density(name: str, points: int, noise: float) -> None:
    shape = SHAPES[name]()
    cloud = uniform_scan(shape, points, noise=noise, normal_noise=10, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert found.position == pytest.approx(noise * shape.diagonal, rel=0.33)


@pytest.mark.parametrize("name", ["bracket", "octopus"])
def test_the_detail_of_a_sparse_scan_is_no_noise(name: str) -> None:
    """What quadrics leave over was taken for noise, up to one half: seven times as much as here."""
    shape = SHAPES[name]()
    cloud = uniform_scan(shape, 5_000, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert found.position < 1e-4 * shape.diagonal


def test_the_detail_that_noise_hides_is_coarser_for_more_noise_and_smoother_shapes() -> None:
    detail = {}
    for name in ("octopus", "torus"):
        shape = SHAPES[name]()
        for noise in (0.001, 0.005):
            cloud = uniform_scan(shape, 20_000, noise=noise, seed=1)
            found = estimate_noise(cloud.points, cloud.normals)
            detail[name, noise] = found.detail / shape.diagonal
    assert detail["octopus", 0.005] > 1.3 * detail["octopus", 0.001]
    assert detail["torus", 0.001] > 1.3 * detail["octopus", 0.001]


def test_a_thin_wall_is_detail_though_both_its_faces_are_flat() -> None:
    """Twice as much was taken for detail, which a quadric through one face follows for ever."""
    cloud = uniform_scan(thin_plate(0.03), 5_000, noise=0.002, seed=1)
    found = estimate_noise(cloud.points, cloud.normals)
    assert 0.03 < found.detail < 5 * 0.03


def test_detail_is_the_same_however_many_points_see_it() -> None:
    shape = SHAPES["octopus"]()
    scans = (uniform_scan(shape, count, noise=0.002, seed=1) for count in (20_000, 200_000))
    few, many = (estimate_noise(cloud.points, cloud.normals).detail for cloud in scans)
    assert many == pytest.approx(few, rel=0.2)


def test_the_digits_of_coordinates_are_no_noise() -> None:
    cloud = uniform_scan(SHAPES["box"](), 5_000, seed=1)
    found = estimate_noise(cloud.points.astype(np.float32).astype(float), cloud.normals)
    assert found.position == found.detail == 0


def test_copies_of_points_do_not_hide_the_noise() -> None:
    shape = SHAPES["sphere"]()
    cloud = uniform_scan(shape, 10_000, noise=0.002, seed=1)
    twice = np.repeat(cloud.points, 2, axis=0), np.repeat(cloud.normals, 2, axis=0)
    found = estimate_noise(*twice).position
    assert found == pytest.approx(0.002 * shape.diagonal, rel=0.33)


def test_noise_of_points_in_even_rows_is_found() -> None:
    """Their closest pairs are all as far apart, which tells nothing of pairs closer still."""
    x, y = np.meshgrid(np.arange(80.0), np.arange(80.0))
    height = 0.3 * np.random.default_rng(1).standard_normal(x.size) + 0.002 * x.ravel() ** 2
    normals = np.tile([0.0, 0.0, 1.0], (x.size, 1))
    found = estimate_noise(np.stack([x.ravel(), y.ravel(), height], 1), normals)
    assert found.position == pytest.approx(0.3, rel=0.15)


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


def test_smoothing_grows_with_the_detail_that_noise_hides_and_falls_with_the_points() -> None:
    few = weights_for_noise(Noise(0.01, 0.3, 0.03, 0.004), 10_000, [64, 1024])[-1]
    many = weights_for_noise(Noise(0.01, 0.3, 0.03, 0.004), 1_000_000, [64, 1024])[-1]
    detailed = weights_for_noise(Noise(0.01, 0.3, 0.015, 0.004), 10_000, [64, 1024])[-1]
    assert few.viscosity == pytest.approx(10 * many.viscosity, rel=0.1)
    assert few.viscosity == pytest.approx(8 * detailed.viscosity, rel=0.1)


def test_normals_weigh_against_points_as_their_variances_say() -> None:
    weights = weights_for_noise(Noise(0.01, 0.2, 0.1, 0.004), 10_000, [1024])[-1]
    variance = 0.2**2 + SHARED_NORMAL_ERROR**2
    assert weights.normal / weights.point == pytest.approx(0.01**2 / variance, rel=1e-3)


def test_normals_weigh_more_against_points_whose_noise_hides_the_voxels_error() -> None:
    voxel = (VOXEL_ERROR / 256) ** 2
    for noise, counted in ((0.0, 0.1 * voxel), (2e-4, 2e-4**2), (1e-3, voxel)):
        weights = weights_for_noise(Noise(noise, 0.0, 0.02, 0.003), 10_000, [64, 256])[-1]
        expected = 0.1 * (noise**2 + counted) / SHARED_NORMAL_ERROR**2
        assert weights.normal == pytest.approx(expected)


def test_normals_made_from_the_points_count_on_the_coarsest_level_alone() -> None:
    noise, resolutions = Noise(0.001, 0.2, 0.02, 0.003), [64, 128, 256]
    given = weights_for_noise(noise, 100_000, resolutions)
    made = weights_for_noise(noise, 100_000, resolutions, derived=True)
    assert [weights.normal for weights in made] == [given[0].normal, 0, 0]
    assert [weights.viscosity for weights in made] == [weights.viscosity for weights in given]


def test_an_exact_scan_still_gets_the_smoothing_of_a_voxel() -> None:
    noise = Noise(0.0, 0.0, 0.0, 0.003)
    for each, level in zip(weights_for_noise(noise, 100_000, [64, 256]), (64, 256), strict=True):
        assert each.viscosity == pytest.approx(LEAST_VISCOSITY / level**1.5)
        assert 0 < each.normal < 1e-3


def test_coarse_voxels_smooth_more_and_trust_normals_more() -> None:
    noise = Noise(0.001, 0.2, 0.02, 0.003)
    coarse, middle, fine = weights_for_noise(noise, 100_000, [64, 128, 256])
    assert coarse.viscosity > middle.viscosity > fine.viscosity
    assert coarse.normal > middle.normal > fine.normal


def _exact(points: np.ndarray) -> np.ndarray:
    return points / np.linalg.norm(points, axis=1, keepdims=True)
