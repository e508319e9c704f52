"""The extracted surface lies where the field is zero and is manifold for any field."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from visco_core.energy import nothing_carried
from visco_core.extract import (
    EDGES,
    MAX_TRIANGLES,
    Isosurface,
    case_table,
    extract_isosurface,
    supported_pieces,
)
from visco_core.grid.samples import locate
from visco_core.grid.topology import Grid, dense_grid, refine
from visco_core.kernels import Backend
from visco_core.mesh_health import mesh_health
from visco_core.result import Mesh


def places(grid: Grid) -> np.ndarray:
    return grid.backend.numpy(grid.ijk) / grid.resolution


def extract(grid: Grid, at_nodes: np.ndarray) -> Isosurface:
    values = np.append(at_nodes, 0).astype(np.float32)
    return extract_isosurface(grid, grid.backend.array(values))


def health(surface: Isosurface) -> dict[str, Any]:
    return mesh_health(Mesh(surface.vertices, surface.faces))


def ball(grid: Grid, center: tuple[float, float, float] | float, radius: float) -> np.ndarray:
    return np.linalg.norm(places(grid) - center, axis=1) - radius


def assert_closed_and_manifold(surface: Isosurface) -> None:
    found = health(surface)
    assert found["watertight"]
    assert found["outward"]
    assert found["nonmanifold_vertices"] == found["unused_vertices"] == 0
    assert found["collapsed_faces"] == 0


def test_a_sphere_s_vertices_lie_on_it_and_its_normals_point_outward(backend: Backend) -> None:
    grid = dense_grid(backend, 33)
    surface = extract(grid, ball(grid, 0.5, 0.31))
    assert_closed_and_manifold(surface)
    assert health(surface)["genus"] == 0
    arm = surface.vertices - 0.5
    radius = np.linalg.norm(arm, axis=1)
    assert np.abs(radius - 0.31).max() * grid.resolution < 0.05
    cosine = np.einsum("vi,vi->v", arm / radius[:, None], surface.normals)
    assert np.degrees(np.arccos(cosine.min())) < 1
    volume = health(surface)["volume"]
    assert volume == pytest.approx(4 / 3 * np.pi * 0.31**3, rel=1e-2)


def test_a_torus_has_one_handle(backend: Backend) -> None:
    grid = dense_grid(backend, 33)
    x, y, z = (places(grid) - 0.5).T
    surface = extract(grid, np.hypot(np.hypot(x, y) - 0.3, z) - 0.1)
    assert_closed_and_manifold(surface)
    assert health(surface)["genus"] == 1


@pytest.mark.parametrize("seed", range(5))
def test_any_noise_gives_a_closed_manifold(seed: int, backend: Backend) -> None:
    """White noise meets every case and every pair of neighbouring cases."""
    grid = dense_grid(backend, 17)
    noise = np.random.default_rng(seed).standard_normal(len(grid))
    border = (backend.numpy(grid.ijk) % 16 == 0).any(1)
    surface = extract(grid, np.where(border, 1.0, noise))
    assert len(surface.faces) > 10_000
    found = health(surface)
    assert found["watertight"]
    assert found["nonmanifold_vertices"] == found["unused_vertices"] == 0
    assert found["collapsed_faces"] == 0


def test_no_triangle_degenerates_where_nodes_lie_exactly_on_the_surface(backend: Backend) -> None:
    """An octahedron: several cut edges end at each node on its surface."""
    grid = dense_grid(backend, 17)
    steps = np.abs(backend.numpy(grid.ijk).astype(int) - 8).sum(1)
    surface = extract(grid, (steps - 5.0) / 16)
    assert_closed_and_manifold(surface)
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0
    reach = np.abs(16 * surface.vertices - 8).sum(1)
    assert np.abs(reach - 5).max() < 1e-3


@pytest.mark.parametrize("case", range(256))
def test_every_case_separates_the_voxel_s_negative_corners(
    case: int, native_backend: Backend
) -> None:
    """One closed sphere around each group of negative corners that are joined by edges."""
    grid = dense_grid(native_backend, 4)
    negative = np.zeros((4, 4, 4), bool)
    negative[1:3, 1:3, 1:3] = (case >> np.arange(8) & 1).reshape(2, 2, 2)
    surface = extract(grid, np.where(negative, -1.0, 0.7).ravel())
    groups = ndimage.label(negative)[1]
    assert health(surface)["components"] == groups
    if groups:
        assert_closed_and_manifold(surface)
        assert health(surface)["genus"] == 0


def test_a_case_uses_exactly_its_cut_edges_and_the_opposite_case_the_same() -> None:
    counts, table = case_table()
    assert counts.max() == MAX_TRIANGLES
    for case in range(256):
        used = set(table[case, : counts[case]].ravel().tolist())
        cut = {
            number
            for number, (corner, axis) in enumerate(EDGES)
            if (case >> corner & 1) != (case >> (corner | 4 >> axis) & 1)
        }
        assert used == cut
        assert not table[case, counts[case] :].any()
        opposite = 255 - case
        assert used == set(table[opposite, : counts[opposite]].ravel().tolist())


def test_a_band_gives_the_surface_of_the_dense_grid(backend: Backend) -> None:
    coarse = dense_grid(backend, 17)
    values = np.append(ball(coarse, (0.45, 0.5, 0.52), 0.3), 0).astype(np.float32)
    band = refine(coarse, backend.array(values), nothing_carried(coarse), 3.0)[0]
    dense = dense_grid(backend, 33)
    on_band = extract(band, ball(band, (0.45, 0.5, 0.52), 0.3))
    everywhere = extract(dense, ball(dense, (0.45, 0.5, 0.52), 0.3))
    np.testing.assert_array_equal(on_band.vertices, everywhere.vertices)
    np.testing.assert_array_equal(on_band.faces, everywhere.faces)
    np.testing.assert_allclose(on_band.normals, everywhere.normals, atol=1e-6)


def test_a_surface_that_leaves_the_grid_is_open_only_there(backend: Backend) -> None:
    grid = dense_grid(backend, 17)
    surface = extract(grid, places(grid)[:, 0] - 0.4)
    found = health(surface)
    assert not found["watertight"]
    assert found["oriented"]
    assert found["nonmanifold_edges"] == found["nonmanifold_vertices"] == 0
    assert found["boundary_edges"] == 4 * grid.resolution
    np.testing.assert_allclose(surface.vertices[:, 0], 0.4, atol=1e-6)
    np.testing.assert_allclose(surface.normals, [[1, 0, 0]] * len(surface.normals), atol=1e-5)


@pytest.mark.parametrize("level", [-1.0, 1.0])
def test_a_field_of_one_sign_has_no_surface(level: float, backend: Backend) -> None:
    grid = dense_grid(backend, 9)
    surface = extract(grid, np.full(len(grid), level))
    assert surface.vertices.shape == surface.faces.shape == (0, 3)
    scan = locate(grid, np.full((20, 3), 0.5), None)
    assert len(supported_pieces(surface, scan, backend).faces) == 0


def on_ball(center: tuple[float, float, float], radius: float, count: int) -> np.ndarray:
    arms = np.random.default_rng(count).standard_normal((count, 3))
    return center + radius * arms / np.linalg.norm(arms, axis=1, keepdims=True)


LARGE, SMALL, GHOST = (0.3, 0.3, 0.3), (0.75, 0.3, 0.3), (0.7, 0.7, 0.7)


def three_balls(backend: Backend) -> tuple[Grid, Isosurface]:
    grid = dense_grid(backend, 33)
    fields = [ball(grid, c, r) for c, r in ((LARGE, 0.2), (SMALL, 0.1), (GHOST, 0.15))]
    return grid, extract(grid, np.min(fields, axis=0))


def test_a_ghost_without_points_goes_and_two_real_bodies_stay(backend: Backend) -> None:
    grid, surface = three_balls(backend)
    points = np.concatenate([on_ball(LARGE, 0.2, 3000), on_ball(SMALL, 0.1, 400)])
    kept = supported_pieces(surface, locate(grid, points, None), backend)
    assert health(surface)["components"] == 3
    assert_closed_and_manifold(kept)
    assert health(kept)["components"] == 2
    assert (np.linalg.norm(kept.vertices - GHOST, axis=1) > 0.2).all()
    for center, radius in ((LARGE, 0.2), (SMALL, 0.1)):
        arm = kept.vertices[np.linalg.norm(kept.vertices - center, axis=1) < 0.25] - center
        assert np.abs(np.linalg.norm(arm, axis=1) - radius).max() * grid.resolution < 0.1
    assert kept.first_vertex[-1] == len(kept.vertices)


def test_a_piece_that_a_few_stray_points_touch_is_a_ghost(backend: Backend) -> None:
    grid, surface = three_balls(backend)
    points = np.concatenate([on_ball(LARGE, 0.2, 3000), on_ball(GHOST, 0.15, 8)])
    kept = supported_pieces(surface, locate(grid, points, None), backend)
    assert health(kept)["components"] == 1
    assert (np.linalg.norm(kept.vertices - LARGE, axis=1) < 0.21).all()


def test_the_best_supported_piece_stays_however_few_its_points_are(backend: Backend) -> None:
    grid, surface = three_balls(backend)
    kept = supported_pieces(surface, locate(grid, on_ball(SMALL, 0.1, 6), None), backend)
    assert health(kept)["components"] == 1
    assert (np.linalg.norm(kept.vertices - SMALL, axis=1) < 0.11).all()
