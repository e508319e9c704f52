"""Levels of the grid nest, keep their band, and know where the scan's points are."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_inputs import CORNERS

from visco_core.energy import nothing_carried
from visco_core.extract import extract_isosurface
from visco_core.grid.samples import CELLS, locate, spatial_order
from visco_core.grid.topology import Grid, dense_grid, keep_closed, refine, voxel_corners
from visco_core.kernels import ENCLOSED, FREE, ROW, Backend
from visco_core.mesh_health import mesh_health
from visco_core.result import Mesh


def sphere(grid: Grid, radius: float = 0.3) -> np.ndarray:
    """The signed distance (N + 1,) of a sphere around the cube's centre at the nodes."""
    places = grid.backend.numpy(grid.ijk) / grid.resolution
    distance = np.linalg.norm(places - 0.5, axis=1) - radius
    return np.append(distance, 0).astype(np.float32)


def refined(backend: Backend, side: int = 17, band_width: float = 3.0) -> tuple[Grid, Grid]:
    coarse = dense_grid(backend, side)
    values = backend.array(sphere(coarse))
    return coarse, refine(coarse, values, nothing_carried(coarse), band_width)[0]


def keys(grid: Grid, stride: int = 1) -> np.ndarray:
    """One number a node, in the numbering of a grid ``stride`` times finer."""
    ijk = stride * grid.backend.numpy(grid.ijk).astype(np.int64)
    return (ijk[:, 0] * 10_000 + ijk[:, 1]) * 10_000 + ijk[:, 2]


def upsampled(values: np.ndarray) -> np.ndarray:
    """Trilinear values (2n − 1,)³ from (n,)³."""
    for axis in range(3):
        up = np.moveaxis(values, axis, 0)
        fine = np.empty((2 * len(up) - 1, *up.shape[1:]))
        fine[::2], fine[1::2] = up, (up[:-1] + up[1:]) / 2
        values = np.moveaxis(fine, 0, axis)
    return values


def corners_of_crossed_voxels(values: np.ndarray) -> np.ndarray:
    """(n,)³, 1 at the corners of voxels in which the signs of ``values`` (n,)³ differ, else 0."""
    crossed = np.zeros(values.shape)
    for voxel in np.ndindex(*(np.array(values.shape) - 1)):
        around = tuple(slice(low, low + 2) for low in voxel)
        negative = values[around] < 0
        if negative.any() and not negative.all():
            crossed[around] = 1
    return crossed


def test_a_dense_grid_has_every_node_and_frees_all_but_its_border(backend: Backend) -> None:
    grid = dense_grid(backend, 9)
    flags = backend.numpy(grid.flags)
    assert grid.is_dense
    assert (len(grid), grid.resolution) == (729, 8)
    inner = ((backend.numpy(grid.ijk) % 8) != 0).all(1)
    np.testing.assert_array_equal(flags[:-1], inner * (ROW | FREE | ENCLOSED))
    assert flags[-1] == 0


def test_columns_and_slabs_say_where_nodes_start(backend: Backend) -> None:
    _, grid = refined(backend)
    ijk, columns = backend.numpy(grid.ijk), backend.numpy(grid.columns)
    for column in range(grid.side**2):
        inside = ijk[columns[column] : columns[column + 1]]
        assert (inside[:, :2] == divmod(column, grid.side)).all()
        assert (np.diff(inside[:, 2]) > 0).all()
    slabs = backend.numpy(grid.slabs)
    np.testing.assert_array_equal(np.diff(slabs), np.bincount(ijk[:, 0], minlength=grid.side))


def test_every_coarse_node_in_the_band_is_a_fine_node_with_the_same_value(
    backend: Backend,
) -> None:
    coarse = dense_grid(backend, 17)
    values = sphere(coarse)
    begun = backend.array(values)
    fine, fine_values, _ = refine(coarse, begun, nothing_carried(coarse), 4.0)
    _, ours, theirs = np.intersect1d(keys(coarse, 2), keys(fine), return_indices=True)
    assert len(ours) == np.count_nonzero(np.abs(values[:-1]) < 4 / fine.resolution)
    np.testing.assert_allclose(backend.numpy(fine_values)[theirs], values[ours], rtol=1e-6)


@pytest.mark.parametrize("band_width", [2.0, 6.0])
def test_refine_keeps_exactly_the_band_and_the_voxels_where_the_sign_changes(
    band_width: float, backend: Backend
) -> None:
    coarse = dense_grid(backend, 17)
    rng = np.random.default_rng(2)
    values = sphere(coarse) + 0.2 * rng.standard_normal(len(coarse) + 1).astype(np.float32)
    values[-1] = 0
    carried = rng.standard_normal((2, len(values))).astype(np.float32)
    given = backend.array(values), backend.array(carried)
    fine, fine_values, fine_carried = refine(coarse, *given, band_width)
    cube = values[:-1].reshape(17, 17, 17)
    expected = upsampled(cube)
    kept = (np.abs(expected) < band_width / 32) | (upsampled(corners_of_crossed_voxels(cube)) == 1)
    np.testing.assert_array_equal(backend.numpy(fine.ijk), np.argwhere(kept))
    np.testing.assert_allclose(backend.numpy(fine_values)[:-1], expected[kept], atol=1e-6)
    for before, after in zip(carried, backend.numpy(fine_carried), strict=True):
        interpolated = upsampled(before[:-1].reshape(17, 17, 17))[kept]
        np.testing.assert_allclose(after[:-1], interpolated, atol=1e-6)
    assert not backend.numpy(fine_values)[-1]
    assert not backend.numpy(fine_carried)[:, -1].any()


def test_the_surface_stays_closed_wherever_the_solve_moves_it_and_however_steep_it_is(
    backend: Backend,
) -> None:
    """Free values of any sign, three levels deep: every edge that is cut has all its voxels."""
    rng = np.random.default_rng(3)
    grid = dense_grid(backend, 9)
    begun = backend.array(sphere(grid))
    for _ in range(3):
        solved = backend.numpy(begun).copy()
        free = backend.numpy(grid.flags) & FREE > 0
        solved[free] = rng.standard_normal(free.sum()) * rng.random(free.sum()) ** 4
        values = keep_closed(grid, begun, backend.array(solved))
        surface = extract_isosurface(grid, values)
        mesh = Mesh(surface.vertices, surface.faces, surface.normals)
        assert mesh_health(mesh)["boundary_edges"] == 0
        kept = backend.numpy(values) == solved
        assert kept[backend.numpy(grid.flags) & ENCLOSED > 0].all()
        grid, begun, _ = refine(grid, values, nothing_carried(grid), 1.0)


def test_a_third_level_nests_in_the_second(backend: Backend) -> None:
    _, second = refined(backend)
    values = sphere(second)
    there = backend.array(values)
    third, third_values, _ = refine(second, there, nothing_carried(second), 3.0)
    assert third.side == 65
    assert not third.is_dense
    _, ours, theirs = np.intersect1d(keys(second, 2), keys(third), return_indices=True)
    np.testing.assert_allclose(backend.numpy(third_values)[theirs], values[ours], rtol=1e-6)
    exact = sphere(third)
    assert np.abs(backend.numpy(third_values) - exact).max() * third.resolution < 0.1


def test_a_band_s_rim_is_fixed_and_its_inside_is_free(backend: Backend) -> None:
    _, grid = refined(backend, band_width=4.0)
    flags = backend.numpy(grid.flags)[:-1]
    there = np.zeros((grid.side + 2,) * 3, bool)
    ijk = backend.numpy(grid.ijk).astype(np.int64)
    there[tuple((ijk + 1).T)] = True
    around = [there[tuple((ijk + shift).T)] for shift in np.ndindex(3, 3, 3)]
    enclosed = np.stack(around).all(0)
    complete = (backend.numpy(grid.neighbours) < len(grid)).all(1)
    np.testing.assert_array_equal(flags, complete * (ROW | FREE) + enclosed * ENCLOSED)
    near = np.abs(sphere(grid)[:-1]) * grid.resolution < 2.5
    assert complete[near].all()


def test_corners_of_a_voxel_are_its_eight_nodes_and_missing_off_the_band(
    backend: Backend,
) -> None:
    _, grid = refined(backend)
    voxels = np.argwhere(np.ones((grid.resolution,) * 3)).astype(np.int32)
    corners = backend.numpy(voxel_corners(grid, backend.array(voxels)))
    whole = corners[:, 0] < len(grid)
    places = backend.numpy(grid.ijk)[corners[whole]]
    np.testing.assert_array_equal(places, voxels[whole][:, None] + CORNERS)
    present = np.zeros((grid.side,) * 3, bool)
    present[tuple(backend.numpy(grid.ijk).T)] = True
    around = voxels[:, None] + CORNERS
    np.testing.assert_array_equal(whole, present[tuple(np.moveaxis(around, 2, 0))].all(1))
    assert (corners[~whole] == len(grid)).all()


def scattered_points(count: int = 3000) -> np.ndarray:
    points = np.random.default_rng(1).random((count, 3))
    points[:8] = CORNERS
    return points


def test_points_keep_their_place_and_normal_when_they_are_sorted_into_voxels(
    backend: Backend,
) -> None:
    """A function that is linear in the point says whether node, local place and normal match."""
    grid = dense_grid(backend, 9)
    points = scattered_points()
    samples = locate(grid, points, points.astype(np.float32))
    corners, starts = backend.numpy(samples.corners), backend.numpy(samples.starts)
    voxel = np.repeat(np.arange(len(corners)), np.diff(starts))
    local, normals = backend.numpy(samples.local), backend.numpy(samples.normals)
    assert samples.total == len(local) == len(points)
    assert local.min() >= 0
    assert local.max() <= 1
    found = (backend.numpy(grid.ijk)[corners[voxel, 0]] + local) / grid.resolution
    np.testing.assert_allclose(found, normals, atol=1e-6)
    np.testing.assert_allclose(np.sort(found, 0), np.sort(points, 0), atol=1e-6)
    assert (np.diff(starts) > 0).all()


def test_voxels_that_hold_points_are_listed_by_slab(backend: Backend) -> None:
    grid = dense_grid(backend, 9)
    points = scattered_points()
    samples = locate(grid, points[points[:, 0] < 0.7], None)
    slab = backend.numpy(grid.ijk)[backend.numpy(samples.corners)[:, 0], 0]
    counts = np.bincount(slab, minlength=grid.side)
    np.testing.assert_array_equal(np.diff(backend.numpy(samples.slabs)), counts)
    assert not backend.numpy(samples.normals).any()


def test_points_of_one_cell_lie_together_in_spatial_order() -> None:
    points = scattered_points() % 1
    order = spatial_order(points)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(points)))
    i, j, k = (points[order] * CELLS).astype(int).T
    assert (np.diff((i * CELLS + j) * CELLS + k) >= 0).all()


def test_points_off_the_band_are_left_out_but_still_count(backend: Backend) -> None:
    _, grid = refined(backend)
    points = scattered_points()
    samples = locate(grid, points, points.astype(np.float32))
    voxels = np.minimum((points * grid.resolution).astype(np.int32), grid.resolution - 1)
    on_band = backend.numpy(voxel_corners(grid, backend.array(voxels)))[:, 0] < len(grid)
    assert 0 < on_band.sum() < len(points)
    assert samples.total == len(points)
    assert len(samples.local) == on_band.sum()
    kept = np.sort(backend.numpy(samples.normals), 0)
    np.testing.assert_array_equal(kept, np.sort(points[on_band].astype(np.float32), 0))
    voxel_count = len(np.unique(voxels[on_band], axis=0))
    assert len(samples.corners) == voxel_count == backend.numpy(samples.slabs)[-1]
