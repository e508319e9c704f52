"""The four losses have the values and gradients that geometry gives them."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from visco_core.losses import coarea_loss, interpolate, normal_loss, point_loss, viscosity_loss

SIDE = 65
NORMAL = torch.tensor([2.0, -1.0, 2.0], dtype=torch.float64) / 3
FAR_CENTER = torch.full((3,), -0.5, dtype=torch.float64)


def nodes(side: int) -> Tensor:
    """Coordinates (side, side, side, 3) of the nodes of the unit cube."""
    ticks = torch.linspace(0, 1, side, dtype=torch.float64)
    return torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), -1)


def plane(side: int = SIDE, offset: float = 0.4) -> Tensor:
    """The exact signed distance of an oblique plane."""
    return nodes(side) @ NORMAL - offset


def far_distance(side: int = SIDE) -> Tensor:
    """Distance from a point outside the cube: smooth everywhere, gradient 1, Laplacian 2/r."""
    return (nodes(side) - FAR_CENTER).norm(dim=-1)


def random_points(count: int, seed: int = 0) -> Tensor:
    return torch.rand(count, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def random_values(side: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(side, side, side, dtype=torch.float64, generator=generator)


def test_viscosity_loss_is_zero_on_an_exact_plane() -> None:
    assert float(viscosity_loss(plane(), 0.01)) < 1e-24


@pytest.mark.parametrize("radius", [0.2, 3.0])
def test_viscosity_residual_of_a_sphere_is_epsilon_times_its_mean_curvature(radius: float) -> None:
    """On an exact distance (‖∇f‖ − 1) vanishes and −ε Δf = −ε·2/r is left, inside and outside."""
    epsilon = 0.01
    distance = far_distance()
    expected = (2 * epsilon / distance[1:-1, 1:-1, 1:-1]).square().sum() / SIDE**3
    assert float(viscosity_loss(distance - radius, epsilon) / expected) == pytest.approx(1, 1e-2)


@pytest.mark.parametrize(("radius", "sign"), [(0.2, 1), (3.0, -1)])
def test_viscosity_residual_joins_stretch_and_curvature_with_the_sign_of_the_side(
    radius: float, sign: int
) -> None:
    """f = a(r − R): the residual is (a − 1)·sign(f) − ε·2a/r."""
    epsilon, stretch = 0.05, 1.1
    distance = far_distance()
    residual = (stretch - 1) * sign - 2 * epsilon * stretch / distance[1:-1, 1:-1, 1:-1]
    loss = viscosity_loss(stretch * (distance - radius), epsilon)
    assert float(loss / (residual.square().sum() / SIDE**3)) == pytest.approx(1, 5e-3)


def test_point_and_normal_losses_are_zero_on_exact_data() -> None:
    values, points = plane(17), random_points(500)
    on_plane = points - (points @ NORMAL - 0.4)[:, None] * NORMAL
    on_plane = on_plane[((on_plane >= 0) & (on_plane <= 1)).all(1)]
    assert len(on_plane) > 100
    assert float(point_loss(values, on_plane)) < 1e-28
    assert float(normal_loss(values, on_plane, NORMAL.expand_as(on_plane))) < 1e-24


def test_point_loss_is_the_mean_squared_distance() -> None:
    points = random_points(300)
    expected = (points @ NORMAL - 0.4).square().mean()
    assert float(point_loss(plane(9), points)) == pytest.approx(float(expected), rel=1e-12)


def test_normal_loss_of_opposite_normals_is_four() -> None:
    points = random_points(50)
    assert float(normal_loss(plane(9), points, -NORMAL.expand_as(points))) == pytest.approx(4)


def test_interpolation_is_exact_for_trilinear_functions_also_on_the_cube_s_faces() -> None:
    x, y, z = nodes(6).unbind(-1)
    values = 1 + 2 * x - y + 3 * z + x * y - 2 * y * z + x * z
    points = torch.cat(
        [random_points(200), torch.cartesian_prod(*[torch.arange(2.0)] * 3).double()]
    )
    value, gradient = interpolate(values, points)
    x, y, z = points.unbind(1)
    torch.testing.assert_close(value, 1 + 2 * x - y + 3 * z + x * y - 2 * y * z + x * z)
    torch.testing.assert_close(gradient, torch.stack([2 + y + z, -1 + x - 2 * z, 3 - 2 * y + x], 1))


@pytest.mark.parametrize("steepness", [0.5, 1.0, 3.0])
def test_coarea_loss_of_a_plane_is_its_area_whatever_the_steepness(steepness: float) -> None:
    """∫ Φβ(f) ‖∇f‖ = ∫ Φβ(s) area(f = s) ds by the coarea formula."""
    beta = 0.1
    values = steepness * (nodes(SIDE)[..., 0] - 0.5)
    reached = 1 - math.exp(-0.5 * steepness / beta)
    voxels_per_node = ((SIDE - 1) / SIDE) ** 3
    assert float(coarea_loss(values, beta)) == pytest.approx(voxels_per_node * reached, rel=1.5e-2)


def test_coarea_loss_of_a_sphere_is_its_area() -> None:
    values = (nodes(SIDE) - 0.5).norm(dim=-1) - 0.3
    voxels_per_node = ((SIDE - 1) / SIDE) ** 3
    beta = 0.02
    mean_area = 4 * math.pi * (0.3**2 + 2 * beta**2)
    assert float(coarea_loss(values, beta)) == pytest.approx(voxels_per_node * mean_area, rel=2e-2)


@pytest.mark.parametrize("side_of_surface", [1.0, -1.0])
def test_laplace_density_decays_on_both_sides_of_the_surface(side_of_surface: float) -> None:
    """Erratum 1: exp(−|s|/β), so moving every value one β away divides the loss by e."""
    beta = 0.02
    near = side_of_surface * (plane(9, offset=-2.0))
    farther = near + side_of_surface * beta
    ratio = coarea_loss(farther, beta) / coarea_loss(near, beta)
    assert float(ratio) == pytest.approx(math.exp(-1), rel=1e-9)


def test_autograd_of_every_loss_agrees_with_finite_differences() -> None:
    values = random_values(5).requires_grad_()
    points = random_points(20)
    normals = torch.nn.functional.normalize(random_points(20, seed=1) - 0.5, dim=1)
    for loss in (
        lambda f: point_loss(f, points),
        lambda f: normal_loss(f, points, normals),
        lambda f: viscosity_loss(f, 0.01),
        lambda f: coarea_loss(f, 0.5),
    ):
        assert torch.autograd.gradcheck(loss, (values,), eps=1e-6, atol=1e-4, rtol=1e-5)
