"""The paper's energy on one level of the grid, and its Gauss-Newton model.

    E(f) = λp/m Σ f(q)² + λn/m Σ ‖∇f(q) − n‖² + λv/N Σ r² + λc/N Σ Φβ ‖∇f‖,   N = side³

The point and normal losses are quadratic in f: per voxel they are one 8 × 8 matrix and one vector,
gathered once, so that an iteration costs nothing per point. The viscosity residual r is linearised;
its matrix JᵀJ is applied in two passes and never formed. Coarea enters by its gradient.

With a target r₀ and a stiffness w the viscosity loss is λv/N Σ w (r − r₀)². Of the residual that
an earlier solution keeps it is the Bregman distance to that (Osher et al., "An iterative
regularization method for total variation-based image restoration", MMS 2005): smoothing then draws
the surface to the one found so far, instead of making it smaller once more.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace

import numpy as np

from visco_core.grid.samples import Samples
from visco_core.grid.topology import Grid
from visco_core.kernels import ROW, Array
from visco_core.presets import Weights
from visco_core.progress import Check, never

HEAT_STEP, WIDEST = 1 / 8, 4.0
"""Of heat on the grid: with 1/6 what changes sign from node to node would stay; and the largest
radius in voxels that is asked of it, since it takes four steps times the radius squared."""

STRAIGHT = 0.4
"""Share of the usual residual below which a surface that bends less gets no stiffer."""


@dataclass(frozen=True)
class Linearisation:
    """The energy around ``values`` (N + 1,).

    ``losses`` are the weighted terms; ``gradient`` (N + 1,) is half the energy's gradient at free
    nodes; ``slopes`` (3, N + 1) define the viscosity rows.
    """

    values: Array
    losses: dict[str, float]
    gradient: Array
    slopes: Array

    @property
    def total(self) -> float:
        return sum(self.losses.values())


class Energy:
    """The energy on ``grid`` for ``samples`` of the scan; ``carried`` (2, N + 1): see ``carry``."""

    def __init__(
        self, grid: Grid, samples: Samples, weights: Weights, carried: Array | None = None
    ) -> None:
        self._target, self._stiffness = nothing_carried(grid) if carried is None else carried
        self.grid, self.samples, self.weights = grid, samples, weights
        self._kernels = grid.backend.kernels
        self._half_inverse = np.float32(0.5 * grid.resolution)
        self._laplace = np.float32(weights.viscosity_epsilon * grid.resolution**2)
        self._scale = np.float32(weights.viscosity / grid.side**3)
        self._rows = grid.backend.zeros(len(grid) + 1)
        self._splines: dict[int, Array] = {}
        self._matrices, self._vectors = self._kernels.point_system(
            samples.local,
            samples.normals,
            samples.starts,
            grid.resolution,
            weights.point / samples.total,
            weights.normal / samples.total,
        )
        self._pull = self.scattered(self._vectors)

    def scattered(self, per_corner: Array) -> Array:
        out = self.grid.backend.zeros(len(self.grid) + 1)
        samples = self.samples
        self._kernels.scatter(per_corner, samples.corners, samples.slabs, self.grid.flags, out)
        return out

    def linearise(self, values: Array) -> Linearisation:
        """Losses, gradient and viscosity rows at ``values`` (N + 1,)."""
        grid, weights, kernels = self.grid, self.weights, self._kernels
        slopes = grid.backend.zeros(3, len(grid) + 1)
        gradient = grid.backend.zeros(len(grid) + 1)
        square = self._fill_rows(values, slopes)
        kernels.viscosity_columns(
            self._rows, slopes, grid.runs, self._laplace, self._scale, gradient
        )
        self._add_points(values, gradient)
        gradient -= self._pull
        losses = self._point_losses(values) | {"viscosity": float(self._scale) * square}
        if weights.coarea:
            losses["coarea"] = self._add_coarea(values, gradient, grid.flags, np.float32(1))
        return Linearisation(values, losses, gradient, slopes)

    def _fill_rows(self, values: Array, slopes: Array) -> float:
        given = values, self._target, self._stiffness, self.grid.runs
        scales = self._half_inverse, self._laplace
        return self._kernels.linearise(*given, *scales, slopes, self._rows)

    def sampled_gradient(self, values: Array, fraction: float, seed: int) -> Array:
        """An unbiased estimate (N + 1,) of the energy's gradient from a share of the voxels.

        Keeps each viscosity row, coarea voxel and voxel of points with probability ``fraction``;
        the same seed keeps the same ones on every backend.
        """
        grid, kernels, backend = self.grid, self._kernels, self.grid.backend
        share = np.float32(1 / fraction)
        kept = self._sample(len(grid) + 1, fraction, 2 * seed)
        flags = grid.flags - (grid.flags & ROW) * (1 - kept)
        gradient = backend.zeros(len(grid) + 1)
        slopes = backend.zeros(3, len(grid) + 1)
        self._fill_rows(values, slopes)
        self._rows *= kept
        kernels.viscosity_columns(
            self._rows, slopes, grid.runs, self._laplace, self._scale * share, gradient
        )
        if self.weights.coarea:
            self._add_coarea(values, gradient, flags, share)
        s = self.samples
        kept = self._sample(len(s.corners), fraction, 2 * seed + 1) > 0
        corners, slabs = s.corners[kept], backend.starts(kept)[s.slabs]
        kernels.scatter(-share * self._vectors[kept], corners, slabs, grid.flags, gradient)
        matrices = share * self._matrices[kept]
        kernels.point_matvec(values, corners, matrices, slabs, grid.flags, gradient)
        return 2 * gradient

    def _sample(self, count: int, fraction: float, seed: int) -> Array:
        """(count,) uint8 on the grid's device; drawn on the CPU, whatever the device."""
        backend = self.grid.backend
        return backend.array(backend.numpy(backend.kernels.sample(count, fraction, seed)))

    def _point_losses(self, values: Array) -> dict[str, float]:
        s, weights = self.samples, self.weights
        square, mismatch = self._kernels.point_sums(
            values, s.corners, s.local, s.normals, s.starts, self.grid.resolution
        )
        return {
            "point": weights.point * square / s.total,
            "normal": weights.normal * mismatch / s.total,
        }

    def _add_points(self, values: Array, out: Array) -> None:
        s = self.samples
        self._kernels.point_matvec(values, s.corners, self._matrices, s.slabs, self.grid.flags, out)

    def _add_coarea(self, values: Array, gradient: Array, flags: Array, share: np.float32) -> float:
        grid = self.grid
        scale = self.weights.coarea / grid.side**3
        total = self._kernels.coarea(
            values,
            grid.neighbours,
            grid.slabs,
            flags,
            np.float32(grid.resolution),
            np.float32(self.weights.coarea_beta),
            np.float32(scale / 2) * share,
            gradient,
        )
        return scale * total

    def matvec(self, at: Linearisation, v: Array, out: Array) -> float:
        """out = (λv/N JᵀWJ + λp/m PᵀP + λn/m GᵀG) v for v (N + 1,) that is zero off free nodes.

        Returns v · out.
        """
        grid, s = self.grid, self.samples
        viscosity = at.slopes, self._stiffness, grid.runs, grid.run_slabs
        points = s.corners, self._matrices, s.slabs
        scales = self._laplace, self._scale
        return self._kernels.operate(v, *viscosity, *scales, *points, grid.flags, self._rows, out)

    def diagonal(self, at: Linearisation) -> Array:
        """The diagonal (N + 1,) of the operator of ``matvec``; zero where nothing is free."""
        grid = self.grid
        out = grid.backend.zeros(len(grid) + 1)
        viscosity = at.slopes, self._stiffness, grid.runs, grid.flags
        self._kernels.viscosity_diagonal(*viscosity, self._laplace, self._scale, out)
        return out + self.scattered(self._matrices[:, 0])

    def spline_energies(self, basis: np.ndarray, spacing: int, side: int) -> Array:
        """What the points and normals make of each spline (side,)³ whose knots lie on the grid.

        basis (2·reach + 1,): the spline along an axis; knots are ``spacing`` nodes apart.
        """
        if spacing not in self._splines:
            s, basis = self.samples, self.grid.backend.array(basis)
            self._splines[spacing] = self._kernels.spline_energies(
                s.corners, self._matrices, s.slabs, self.grid.ijk, basis, spacing, side
            )
        return self._splines[spacing]

    def viscosity_of_spline(self, basis: np.ndarray) -> float:
        """λv/N Σ (J φ)² of one such spline φ, averaged over the directions of n̂."""
        line = np.pad(basis.astype(np.float64), 2)
        cube = line[:, None, None] * line[:, None] * line
        slopes, laplacian = 0.0, -6 * cube
        for axis in range(3):
            low, high = np.roll(cube, 1, axis), np.roll(cube, -1, axis)
            slopes += np.square((high - low) * self._half_inverse).sum() / 3
            laplacian += low + high
        return float(self._scale * (slopes + np.square(self._laplace * laplacian).sum()))

    def with_viscosity(
        self, *, weight: float | None = None, epsilon: float | None = None
    ) -> Energy:
        """The same energy with another λv or ε; shares the points' matrices."""
        other, old = copy.copy(self), self.weights
        weight = old.viscosity if weight is None else weight
        epsilon = old.viscosity_epsilon if epsilon is None else epsilon
        other.weights = replace(old, viscosity=weight, viscosity_epsilon=epsilon)
        other._scale = np.float32(weight / self.grid.side**3)
        other._laplace = np.float32(epsilon * self.grid.resolution**2)
        return other


def nothing_carried(grid: Grid) -> Array:
    """(2, N + 1): r₀ = 0 and w = 1 everywhere."""
    carried = grid.backend.zeros(2, len(grid) + 1)
    carried[1] += 1
    return carried


def carry(
    grid: Grid,
    samples: Samples,
    values: Array,
    epsilon: float,
    radius: float,
    check: Check = never,
) -> Array:
    """What ``values`` (N + 1,) say of the next level's viscosity: r₀ and w, (2, N + 1).

    At the corners of voxels with points r₀ is the mean of r there under a Gaussian of deviation
    ``radius`` voxels. Where the surface bends much, smoothing shall be less:
    w = √((1 + c²)/(q/Q + c²)) where q is the mean of r₀² likewise, Q that over all and c
    ``STRAIGHT``. So the loss grows as |r| rather than r² from place to place: the lagged
    diffusivity of total variation (Vogel and Oman, "Iterative methods for total variation
    denoising", SISC 1996). Elsewhere r₀ = 0 and w = 1.
    """
    backend, kernels, nodes = grid.backend, grid.backend.kernels, len(grid) + 1
    carried = nothing_carried(grid)
    rows, near, slopes = backend.zeros(nodes), backend.zeros(nodes), backend.zeros(3, nodes)
    scales = np.float32(0.5 * grid.resolution), np.float32(epsilon * grid.resolution**2)
    kernels.linearise(values, *carried, grid.runs, *scales, slopes, rows)
    ones = backend.array(np.ones(samples.corners.shape, np.float32))
    kernels.scatter(ones, samples.corners, samples.slabs, grid.flags, near)
    near[near > 0] = 1
    weight = spread(grid, near, radius, check) + (1 - near)
    target = near * spread(grid, near * rows, radius, check) / weight
    bent = near * spread(grid, target * target, radius, check) / weight
    usual = float(bent.sum()) / max(float(near.sum()), 1)
    if usual > 0:
        carried[0] = target
        carried[1] = ((1 + STRAIGHT**2) / (bent / usual + STRAIGHT**2)) ** 0.5
        carried[1][near == 0] = 1
    return carried


def spread(grid: Grid, field: Array, radius: float, check: Check = never) -> Array:
    """``field`` (N + 1,) under a Gaussian of deviation ``radius`` voxels, as heat spreads.

    A radius beyond ``WIDEST`` counts as that.
    """
    variance = min(radius, WIDEST) ** 2
    steps = math.ceil(variance / (2 * HEAT_STEP))
    flat, more = grid.backend.zeros(3, len(grid) + 1), grid.backend.zeros(len(grid) + 1)
    for _ in range(steps):
        check()
        # Without slopes Jᵀ is the Laplacian; each step adds twice its length to the variance.
        length = np.float32(variance / (2 * steps))
        grid.backend.kernels.viscosity_columns(field, flat, grid.runs, np.float32(-1), length, more)
        field = field + more
    return field
