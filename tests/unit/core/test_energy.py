"""The assembled energy is that of the plain losses, and its model is theirs to first order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter
from torch import Tensor

from visco_core.energy import Energy, Linearisation, carry, nothing_carried
from visco_core.grid.samples import locate
from visco_core.grid.topology import dense_grid, refine
from visco_core.kernels import FREE, Backend
from visco_core.losses import coarea_loss, interpolate, normal_loss, point_loss, viscosity_loss
from visco_core.presets import Weights
from visco_core.solvers.preconditioner import spline_basis

WEIGHTS = Weights(
    point=0.1, normal=2e-3, viscosity=1e-2, coarea=1e-2, viscosity_epsilon=0.02, coarea_beta=0.01
)
NONE = replace(WEIGHTS, point=0.0, normal=0.0, viscosity=0.0, coarea=0.0)
ONLY = {
    name: replace(NONE, **{name: getattr(WEIGHTS, name)})
    for name in ("point", "normal", "viscosity", "coarea")
}


def scan_of_a_sphere(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) near a sphere in the cube's middle and normals (P, 3) that are not exact."""
    rng = np.random.default_rng(0)
    normals = rng.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 0.5 + 0.3 * normals + 0.01 * rng.standard_normal((count, 3))
    tilted = normals + 0.2 * rng.standard_normal((count, 3))
    return points, (tilted / np.linalg.norm(tilted, axis=1, keepdims=True)).astype(np.float32)


def noisy_distance(side: int, noise: float = 0.3) -> np.ndarray:
    """A sphere's distance (side³ + 1,), disturbed by ``noise`` voxels."""
    rng = np.random.default_rng(1)
    ticks = np.linspace(-0.5, 0.5, side)
    x, y, z = np.meshgrid(ticks, ticks, ticks, indexing="ij")
    values = np.sqrt(x**2 + y**2 + z**2) - 0.3 + noise / side * rng.standard_normal((side,) * 3)
    return np.append(values, 0).astype(np.float32)


def make_energy(backend: Backend, weights: Weights, side: int = 17) -> Energy:
    grid = dense_grid(backend, side)
    return Energy(grid, locate(grid, *scan_of_a_sphere()), weights)


def plain_losses(values: Tensor, weights: Weights) -> dict[str, Tensor]:
    """The weighted losses of ``visco_core.losses`` at (n, n, n) values."""
    points, normals = (torch.from_numpy(a).double() for a in scan_of_a_sphere())
    return {
        "point": weights.point * point_loss(values, points),
        "normal": weights.normal * normal_loss(values, points, normals),
        "viscosity": weights.viscosity * viscosity_loss(values, weights.viscosity_epsilon),
        "coarea": weights.coarea * coarea_loss(values, weights.coarea_beta),
    }


def as_cube(values: np.ndarray) -> Tensor:
    side = round(len(values) ** (1 / 3))
    return torch.from_numpy(values[:-1].astype(np.float64)).reshape(side, side, side)


@pytest.mark.parametrize("name", ONLY)
def test_losses_and_gradient_are_those_of_the_plain_loss(name: str, backend: Backend) -> None:
    """``gradient`` is half the energy's, at free nodes.

    The energy leaves out coarea voxels at the cube's low faces, where the density is 1e-9 here.
    """
    values = noisy_distance(17)
    at = make_energy(backend, ONLY[name]).linearise(backend.array(values))
    cube = as_cube(values).requires_grad_()
    expected = plain_losses(cube, ONLY[name])[name]
    (slope,) = torch.autograd.grad(expected, cube)
    assert at.losses[name] == pytest.approx(expected.item(), rel=1e-5)
    assert at.total == pytest.approx(expected.item(), rel=1e-5)
    free = torch.zeros_like(slope)
    free[1:-1, 1:-1, 1:-1] = slope[1:-1, 1:-1, 1:-1]
    gradient = 2 * backend.numpy(at.gradient)
    largest = float(slope.abs().max())
    np.testing.assert_allclose(gradient[:-1], free.flatten().numpy(), atol=2e-5 * largest)
    assert gradient[-1] == 0


def test_all_losses_add_up(backend: Backend) -> None:
    values = noisy_distance(17)
    at = make_energy(backend, WEIGHTS).linearise(backend.array(values))
    expected = plain_losses(as_cube(values), WEIGHTS)
    assert at.losses.keys() == expected.keys()
    assert at.total == pytest.approx(float(sum(expected.values())), rel=1e-5)


def test_points_alone_make_up_the_energy_where_coarea_has_no_weight(backend: Backend) -> None:
    losses = make_energy(backend, ONLY["point"]).linearise(backend.array(noisy_distance(17))).losses
    assert "coarea" not in losses
    assert losses["normal"] == losses["viscosity"] == 0


def jacobians(values: np.ndarray, weights: Weights) -> list[tuple[float, Tensor]]:
    """(weight, Jacobian of the residuals) of the point, normal and viscosity losses."""
    cube = as_cube(values)
    side = len(cube)
    points, _ = (torch.from_numpy(a).double() for a in scan_of_a_sphere())

    def viscosity(flat: Tensor) -> Tensor:
        f = flat.reshape(side, side, side)
        inner = [slice(1, -1)] * 3
        gradient, laplacian = [], -6 * f[1:-1, 1:-1, 1:-1]
        for axis in range(3):
            low, high = list(inner), list(inner)
            low[axis], high[axis] = slice(None, -2), slice(2, None)
            gradient.append((f[tuple(high)] - f[tuple(low)]) * (side - 1) / 2)
            laplacian = laplacian + f[tuple(high)] + f[tuple(low)]
        stretch = (torch.stack(gradient).norm(dim=0) - 1) * torch.sign(f[1:-1, 1:-1, 1:-1])
        return (stretch - weights.viscosity_epsilon * (side - 1) ** 2 * laplacian).flatten()

    def at_points(part: int):
        return lambda f: interpolate(f.reshape(side, side, side), points)[part].flatten()

    rows = [
        (weights.point / len(points), at_points(0)),
        (weights.normal / len(points), at_points(1)),
        (weights.viscosity / side**3, viscosity),
    ]
    jacobian = torch.autograd.functional.jacobian
    return [(weight, jacobian(residual, cube.flatten())) for weight, residual in rows]


def operator(energy: Energy, at: Linearisation) -> np.ndarray:
    """The matrix (K, K) of ``matvec`` on the free nodes, column by column."""
    backend = energy.grid.backend
    free = np.flatnonzero(backend.numpy(energy.grid.flags) & FREE)
    columns = []
    for node in free:
        unit = np.zeros(len(energy.grid) + 1, np.float32)
        unit[node] = 1
        out = backend.zeros(len(unit))
        energy.matvec(at, backend.array(unit), out)
        columns.append(backend.numpy(out)[free])
    return np.stack(columns, 1)


def test_matvec_and_diagonal_are_those_of_the_dense_gauss_newton_matrix(backend: Backend) -> None:
    side = 7
    values = noisy_distance(side)
    plain = make_energy(backend, replace(WEIGHTS, coarea=0.0), side)
    carried = np.random.default_rng(4).random((2, len(values))).astype(np.float32)
    energy = Energy(plain.grid, plain.samples, plain.weights, backend.array(carried))
    at = energy.linearise(backend.array(values))
    free = np.flatnonzero(backend.numpy(energy.grid.flags) & FREE)
    *points, (weight, rows) = jacobians(values, WEIGHTS)
    weighted = [*points, (weight, torch.from_numpy(carried[1, free])[:, None] ** 0.5 * rows)]
    expected = sum(w * (j.T @ j) for w, j in weighted).numpy()[free][:, free]
    found = operator(energy, at)
    np.testing.assert_allclose(found, expected, atol=1e-5 * expected.max())
    diagonal = backend.numpy(energy.diagonal(at))
    np.testing.assert_allclose(diagonal[free], expected.diagonal(), rtol=1e-4)
    assert np.count_nonzero(diagonal) == len(free)


def test_a_target_is_taken_off_the_viscosity_residual(backend: Backend) -> None:
    plain = make_energy(backend, ONLY["viscosity"])
    values = noisy_distance(17)
    epsilon = WEIGHTS.viscosity_epsilon
    carried = carry(plain.grid, plain.samples, backend.array(values), epsilon, 0.0)
    energy = Energy(plain.grid, plain.samples, ONLY["viscosity"], carried)
    kept = backend.numpy(carried[0]).astype(np.float64)
    near = np.unique(backend.numpy(plain.samples.corners))
    free = near[(backend.numpy(plain.grid.flags)[near] & FREE) > 0]
    np.testing.assert_array_equal(np.flatnonzero(kept), free)
    whole = plain.linearise(backend.array(values)).total
    taken_off = ONLY["viscosity"].viscosity / 17**3 * np.square(kept).sum()
    assert 0.1 * whole < taken_off < 0.9 * whole
    at = energy.linearise(backend.array(values))
    assert at.total == pytest.approx(whole - taken_off, rel=1e-5)
    gradient = backend.numpy(at.gradient)
    step = np.float32(1e-4 / np.abs(gradient).max()) * gradient
    up, down = (energy.linearise(backend.array(values + s)).total for s in (step, -step))
    assert up - down == pytest.approx(4 * gradient @ step, rel=0.01)


def test_what_is_carried_are_means_over_the_corners_of_voxels_with_points(
    backend: Backend,
) -> None:
    side, radius = 33, 1.5
    energy = make_energy(backend, ONLY["viscosity"], side)
    given = energy.grid, energy.samples, backend.array(noisy_distance(side)), 0.02
    plain, (target, stiffness) = (
        backend.numpy(carry(*given, over))[:, :-1].reshape((2, *(side,) * 3))
        for over in (0.0, radius)
    )
    residual, near = plain[0], plain[0] != 0

    def mean(field: np.ndarray) -> np.ndarray:
        sums, weights = (
            gaussian_filter(a.astype(float), radius, mode="constant")[near]
            for a in (np.where(near, field, 0), near)
        )
        return sums / weights

    def off(found: np.ndarray, expected: np.ndarray) -> float:
        return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))

    assert 0 < target[near].std() < 0.5 * residual[near].std()
    assert off(target[near], mean(residual)) < 0.1
    bent = mean(np.square(target))
    assert off(stiffness[near] ** -2, (bent / bent.mean() + 0.16) / 1.16) < 0.1
    assert not target[~near].any()
    assert (stiffness[~near] == 1).all()


def test_a_flat_surface_is_as_stiff_everywhere(backend: Backend) -> None:
    grid = dense_grid(backend, 9)
    plane = np.append((backend.numpy(grid.ijk)[:, 0] - 4) / 8, 0).astype(np.float32)
    samples = locate(grid, np.full((1, 3), 0.5), None)
    target, stiffness = carry(grid, samples, backend.array(plane), 0.02, 1.0)
    assert not backend.numpy(target).any()
    assert (backend.numpy(stiffness) == 1).all()


def test_matvec_is_symmetric_and_positive_on_a_band(backend: Backend) -> None:
    coarse = dense_grid(backend, 5)
    begun = backend.array(noisy_distance(5, noise=0.0))
    grid, values, _ = refine(coarse, begun, nothing_carried(coarse), 1.6)
    assert not grid.is_dense
    energy = Energy(grid, locate(grid, *scan_of_a_sphere()), WEIGHTS)
    matrix = operator(energy, energy.linearise(values))
    assert len(matrix) > 20
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-6 * matrix.max())
    assert np.linalg.eigvalsh(matrix.astype(np.float64)).min() > -1e-6 * matrix.max()


def test_matvec_predicts_how_the_gradient_changes(backend: Backend) -> None:
    """Point and normal losses are quadratic, so half their gradient changes by exactly M δ."""
    energy = make_energy(backend, replace(ONLY["point"], normal=WEIGHTS.normal))
    values = noisy_distance(17)
    step = np.random.default_rng(3).standard_normal(len(values)).astype(np.float32)
    step *= (backend.numpy(energy.grid.flags) & FREE) > 0
    at, after = (energy.linearise(backend.array(v)) for v in (values, values + step))
    out = backend.zeros(len(values))
    energy.matvec(at, backend.array(step), out)
    change = backend.numpy(after.gradient) - backend.numpy(at.gradient)
    np.testing.assert_allclose(change, backend.numpy(out), atol=1e-5 * np.abs(change).max())


def test_sampling_everything_gives_the_whole_gradient(backend: Backend) -> None:
    energy, values = make_energy(backend, WEIGHTS), backend.array(noisy_distance(17))
    whole = 2 * backend.numpy(energy.linearise(values).gradient)
    sampled = backend.numpy(energy.sampled_gradient(values, 1.0, seed=5))
    np.testing.assert_allclose(sampled, whole, atol=1e-5 * np.abs(whole).max())


@pytest.mark.parametrize("name", ONLY)
def test_sampled_gradient_is_unbiased(name: str, native_backend: Backend) -> None:
    """The mean over seeds is the whole gradient, as far as its own scatter allows."""
    energy = make_energy(native_backend, ONLY[name], side=9)
    values = noisy_distance(9)
    whole = 2 * energy.linearise(values).gradient
    samples = np.stack([energy.sampled_gradient(values, 0.3, seed) for seed in range(600)])
    error = samples.std(0) / np.sqrt(len(samples))
    assert np.count_nonzero(error) > 50
    off = np.abs(samples.mean(0) - whole) / np.maximum(error, 1e-6 * np.abs(whole).max())
    assert off.max() < 6
    assert np.sqrt(np.square(off[error > 0]).mean()) < 1.5


def test_a_seed_decides_the_sample(native_backend: Backend, reference_backend: Backend) -> None:
    values = noisy_distance(9)
    ours = make_energy(native_backend, WEIGHTS, side=9)
    theirs = make_energy(reference_backend, WEIGHTS, side=9)
    first = ours.sampled_gradient(values, 0.2, seed=3)
    np.testing.assert_array_equal(first, ours.sampled_gradient(values, 0.2, seed=3))
    assert (first != ours.sampled_gradient(values, 0.2, seed=4)).any()
    other = theirs.sampled_gradient(reference_backend.array(values), 0.2, seed=3).numpy()
    np.testing.assert_allclose(first, other, atol=1e-5 * np.abs(other).max())


def test_another_viscosity_gives_the_energy_that_was_built_with_it(backend: Backend) -> None:
    values = backend.array(noisy_distance(17))
    other = replace(WEIGHTS, viscosity=3 * WEIGHTS.viscosity, viscosity_epsilon=0.1)
    built = make_energy(backend, other).linearise(values)
    energy = make_energy(backend, WEIGHTS)
    before = energy.linearise(values)
    changed = energy.with_viscosity(weight=other.viscosity, epsilon=0.1).linearise(values)
    assert changed.losses == built.losses
    assert changed.losses["viscosity"] != before.losses["viscosity"]
    assert energy.linearise(values).losses == before.losses


@pytest.mark.parametrize("level", [1, 2])
def test_viscosity_of_a_spline_is_its_energy_averaged_over_directions(
    level: int, backend: Backend
) -> None:
    energy = make_energy(backend, ONLY["viscosity"])
    basis = spline_basis(level)
    line = np.pad(basis, (17 - len(basis)) // 2)
    spline = np.append(line[:, None, None] * line[:, None] * line, 0).astype(np.float32)
    total = 0.0
    for direction in np.concatenate([np.eye(3), -np.eye(3)]):
        slopes = np.zeros((3, len(spline)), np.float32)
        slopes[:, :-1] = direction[:, None] * energy.grid.resolution / 2
        at = Linearisation(backend.zeros(0), {}, backend.zeros(0), backend.array(slopes))
        out = backend.zeros(len(spline))
        energy.matvec(at, backend.array(spline), out)
        total += float(spline @ backend.numpy(out)) / 6
    assert energy.viscosity_of_spline(basis) == pytest.approx(total, rel=1e-4)


def test_spline_energies_are_those_of_the_point_and_normal_losses(backend: Backend) -> None:
    """Splines cannot move the fixed border, so only those that vanish there are compared."""
    energy = make_energy(backend, replace(ONLY["point"], normal=WEIGHTS.normal))
    basis = spline_basis(1)
    found = backend.numpy(energy.spline_energies(basis, 2, 9))
    at = energy.linearise(backend.zeros(17**3 + 1))
    for knot in [(2, 4, 4), (4, 4, 6), (5, 3, 6)]:
        factors = np.zeros((3, 17), np.float32)
        for axis, k in enumerate(knot):
            factors[axis, 2 * k - 2 : 2 * k + 3] = basis
        spline = np.append(np.einsum("i,j,k->ijk", *factors), 0).astype(np.float32)
        out = backend.zeros(len(spline))
        energy.matvec(at, backend.array(spline), out)
        assert float(found[knot]) == pytest.approx(float(spline @ backend.numpy(out)), rel=1e-4)
        assert found[knot] > 0
