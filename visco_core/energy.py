"""The paper's energy on one level of the grid, and its Gauss-Newton model.

    E(f) = λp/m Σ f(q)² + λn/m Σ ‖∇f(q) − n‖² + λv/N Σ r² + λc/N Σ Φβ ‖∇f‖,   N = side³

The point and normal losses are quadratic in f: per voxel they are one 8 × 8 matrix and one vector,
gathered once, so that an iteration costs nothing per point. The viscosity residual r is linearised;
its matrix JᵀJ is applied in two passes and never formed. Coarea enters by its gradient.

With a target r₀ the viscosity loss is λv/N Σ (r − r₀)². Of the residual that an earlier solution
keeps it is the Bregman distance to that (Osher et al., "An iterative regularization method for
total variation-based image restoration", MMS 2005): smoothing then draws the surface to the one
found so far, instead of making it smaller once more.
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

HEAT_STEP = 1 / 8
"""Of heat on the grid; beyond 1/6 it is not stable."""


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
    """The energy on ``grid`` for ``samples`` of the scan; ``target`` (N + 1,) is r₀, else 0."""

    def __init__(
        self, grid: Grid, samples: Samples, weights: Weights, target: Array | None = None
    ) -> None:
        self._target = grid.backend.zeros(len(grid) + 1) if target is None else target
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
        given = values, self._target, self.grid.runs, self._half_inverse, self._laplace
        return self._kernels.linearise(*given, slopes, self._rows)

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
        """out = (λv/N JᵀJ + λp/m PᵀP + λn/m GᵀG) v for v (N + 1,) that is zero off free nodes.

        Returns v · out.
        """
        grid, s = self.grid, self.samples
        rows = at.slopes, grid.runs, grid.run_slabs, self._laplace, self._scale
        points = s.corners, self._matrices, s.slabs
        return self._kernels.operate(v, *rows, *points, grid.flags, self._rows, out)

    def diagonal(self, at: Linearisation) -> Array:
        """The diagonal (N + 1,) of the operator of ``matvec``; zero where nothing is free."""
        grid = self.grid
        out = grid.backend.zeros(len(grid) + 1)
        self._kernels.viscosity_diagonal(
            at.slopes, grid.runs, grid.flags, self._laplace, self._scale, out
        )
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


def viscosity_residual(
    grid: Grid, samples: Samples, values: Array, epsilon: float, radius: float = 0.0
) -> Array:
    """r (N + 1,) of ``values`` (N + 1,) at the corners of voxels with points, zero elsewhere.

    There it is the mean, under a Gaussian of deviation ``radius`` voxels, over all such corners.
    """
    backend, kernels, nodes = grid.backend, grid.backend.kernels, len(grid) + 1
    rows, touched = backend.zeros(nodes), backend.zeros(nodes)
    scales = np.float32(0.5 * grid.resolution), np.float32(epsilon * grid.resolution**2)
    none, slopes = backend.zeros(nodes), backend.zeros(3, nodes)
    kernels.linearise(values, none, grid.runs, *scales, slopes, rows)
    ones = backend.array(np.ones(samples.corners.shape, np.float32))
    kernels.scatter(ones, samples.corners, samples.slabs, grid.flags, touched)
    touched = backend.zeros(nodes) + (touched > 0)
    sums = [rows * touched, touched + 0]
    steps = math.ceil(radius**2 / (2 * HEAT_STEP))
    if not steps:
        return sums[0]
    slopes *= 0
    for each in sums:
        for _ in range(steps):
            # Jᵀ without slopes is the Laplacian: heat that spreads, of which each step adds twice
            # its length to the variance.
            length = np.float32(radius**2 / (2 * steps))
            kernels.viscosity_columns(each, slopes, grid.runs, np.float32(-1), length, none)
            each += none
    return touched * sums[0] / (sums[1] + (1 - touched))
