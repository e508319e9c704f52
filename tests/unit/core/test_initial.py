"""The starting field has the right sign everywhere and about the right distance."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_inputs import CORNERS

from visco_core.gallery import (
    Shape,
    add_outliers,
    flip_normals,
    sphere,
    torus,
    two_bodies,
    uniform_scan,
    vary_density,
)
from visco_core.initial import potential, sample_cells, starting_values, surface_areas
from visco_core.kernels import Backend
from visco_core.pointcloud import PointCloud

RESOLUTION = 32


def in_cube(shape: Shape, places: np.ndarray) -> np.ndarray:
    """The shape's signed distance, for a shape of size 1 to 2 shrunk by 0.4 into the cube."""
    return 0.4 * shape.sdf((places - 0.5) / 0.4)


def start(backend: Backend, cloud: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 3) of the nodes and the starting values (N,) there."""
    assert cloud.normals is not None
    values = starting_values(backend, 0.5 + 0.4 * cloud.points, cloud.normals, RESOLUTION)
    ticks = np.linspace(0, 1, RESOLUTION + 1)
    places = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3)
    assert values.shape == (len(places) + 1,)
    assert values.dtype == np.float32
    assert values[-1] == 0
    return places, values[:-1]


@pytest.mark.parametrize("make", [sphere, torus, two_bodies])
def test_start_is_negative_inside_and_within_two_voxels_of_the_distance(
    make, native_backend: Backend
) -> None:
    shape = make()
    places, values = start(native_backend, uniform_scan(shape, 4000))
    exact = in_cube(shape, places)
    decided = np.abs(exact) > 1 / RESOLUTION
    assert (np.sign(values) == np.sign(exact))[decided].all()
    assert np.abs(values - exact).max() * RESOLUTION < 2
    assert np.abs(values - exact).mean() * RESOLUTION < 0.5


def test_both_backends_start_alike(native_backend: Backend, reference_backend: Backend) -> None:
    cloud = uniform_scan(torus(), 3000)
    _, ours = start(native_backend, cloud)
    _, theirs = start(reference_backend, cloud)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_a_tenth_of_wrong_normals_changes_no_sign(native_backend: Backend) -> None:
    cloud = flip_normals(uniform_scan(sphere(), 4000), 0.1)
    places, values = start(native_backend, cloud)
    exact = in_cube(sphere(), places)
    decided = np.abs(exact) > 1 / RESOLUTION
    assert (np.sign(values) == np.sign(exact))[decided].all()


def test_a_part_scanned_a_thousand_times_sparser_changes_no_sign(native_backend: Backend) -> None:
    cloud = vary_density(uniform_scan(sphere(), 60_000), 1000)
    places, values = start(native_backend, cloud)
    exact = in_cube(sphere(), places)
    decided = np.abs(exact) > 3 / RESOLUTION
    assert (np.sign(values) == np.sign(exact))[decided].all()


def test_the_areas_that_points_stand_for_follow_their_density() -> None:
    even = uniform_scan(sphere(), 60_000)
    cloud = vary_density(even, 100)
    areas = surface_areas(cloud.points)
    along = cloud.points[:, np.ptp(even.points, axis=0).argmax()]
    dense, sparse = (np.median(areas[np.abs(along - a) < 0.1]) for a in (-0.5, 0.5))
    assert sparse / dense == pytest.approx(10, rel=0.6)


def test_points_of_an_even_scan_all_stand_for_the_same_area() -> None:
    areas = surface_areas(uniform_scan(sphere(), 20_000).points)
    assert (areas == 1).mean() > 0.95


def test_an_outlier_beside_a_surface_stands_for_no_more_than_its_neighbours() -> None:
    cloud = uniform_scan(sphere(), 20_000)
    areas = surface_areas(add_outliers(cloud, 0.001).points)
    assert areas.max() <= 4 * np.median(areas)


def test_what_a_scan_from_one_side_leaves_open_is_closed_before_the_rim(
    native_backend: Backend,
) -> None:
    """A few points of a slope that reaches from edge to edge, all facing up."""
    x, y = np.random.default_rng(4).uniform(0.05, 0.95, (2, 60))
    points, normals = np.stack([x, y, x], 1), np.tile(np.float32([-1, 0, 1]), (60, 1))
    values = starting_values(native_backend, points, normals / np.sqrt(np.float32(2)), RESOLUTION)
    cube = values[:-1].reshape((RESOLUTION + 1,) * 3)
    assert cube.min() < 0
    cube[1:-1, 1:-1, 1:-1] = 1
    assert cube.min() > 0


def test_potential_steps_up_from_inside_to_outside_across_the_points(
    native_backend: Backend,
) -> None:
    cloud = uniform_scan(sphere(), 4000)
    assert cloud.normals is not None
    points = 0.5 + 0.4 * cloud.points
    field = potential(native_backend, points, cloud.normals, 2 * RESOLUTION)
    assert abs(np.median(sample_cells(field, points))) < 1e-6 * np.ptp(field)
    steps = [sample_cells(field, points + d * cloud.normals) for d in (-0.05, 0.0, 0.05)]
    assert steps[0].max() < steps[1].min()
    assert steps[1].max() < steps[2].min()


def test_cells_are_sampled_at_their_centres_and_linearly_between() -> None:
    cells = np.argwhere(np.ones((8, 8, 8))).reshape(8, 8, 8, 3) + 0.5
    field = (cells / 8) @ np.array([1.0, -2.0, 0.5])
    points = np.random.default_rng(0).uniform(0.1, 0.9, (200, 3))
    np.testing.assert_allclose(sample_cells(field, points), points @ [1.0, -2.0, 0.5], atol=1e-6)
    assert sample_cells(field, np.full((1, 3), 2.0)) == field[-1, -1, -1].astype(np.float32)


def test_a_field_without_another_side_stays_finite(native_backend: Backend) -> None:
    """Normals that all point the same way on eight points enclose nothing."""
    points = 0.25 + 0.5 * CORNERS
    normals = np.tile(np.float32([0, 0, 1]), (8, 1))
    values = starting_values(native_backend, points, normals, 16)
    assert np.isfinite(values).all()
    assert np.abs(values).max() <= 1
