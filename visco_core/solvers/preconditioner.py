"""What conjugate gradients are preconditioned with: the diagonal, and on a dense grid BPX.

BPX (Bramble, Pasciak, Xu, "Parallel multilevel preconditioners", Math. Comp. 1990) adds, to the
diagonal's correction, those of a few coarser grids:

    z = D₀⁻¹ r + Σ_l P_l D_l⁻¹ P_lᵀ r

The viscosity term is close to a biharmonic operator, for which trilinear prolongation is not smooth
enough; P_l are cubic B-splines. D_l is the energy of one spline: exact for the points, and for the
viscosity term averaged over the directions of n̂.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from visco_core.energy import Energy
from visco_core.kernels import Array

Preconditioner = Callable[[Array], Array]

COARSER_GRIDS = 3


def jacobi(diagonal: Array) -> Preconditioner:
    """Division by the operator's diagonal (N + 1,), zero where that is zero."""
    inverse = (diagonal > 0) / (diagonal + (diagonal == 0))
    return lambda residual: inverse * residual


class Multilevel:
    """BPX for an energy whose grid is dense; built once, used for every linearisation."""

    def __init__(self, energy: Energy) -> None:
        self._grid = energy.grid
        self._kernels = energy.grid.backend.kernels
        side = energy.grid.side
        self._inverses = []
        for level in range(1, COARSER_GRIDS + 1):
            side = side // 2 + 1
            basis = spline_basis(level)
            points = energy.spline_energies(basis, 2**level, side)
            self._inverses.append(1 / (points + energy.viscosity_of_spline(basis)))

    def __call__(self, diagonal: Array) -> Preconditioner:
        """The preconditioner for the operator whose diagonal (N + 1,) is given."""
        fine = jacobi(diagonal)

        def apply(residual: Array) -> Array:
            out = fine(residual)
            out[:-1] += self._coarse(residual).reshape(-1)
            return out

        return apply

    def _coarse(self, residual: Array) -> Array:
        side = self._grid.side
        restricted = [residual[:-1].reshape(side, side, side)]
        for _ in self._inverses:
            restricted.append(self._kernels.spline_restrict(restricted[-1]))
        total = restricted[-1] * self._inverses[-1]
        for inverse, r in zip(self._inverses[-2::-1], restricted[-2:0:-1], strict=True):
            total = inverse * r + self._kernels.spline_prolong(total, len(r))
        out = self._kernels.spline_prolong(total, side)
        # The cube's rim is fixed.
        out[:: side - 1] = out[:, :: side - 1] = out[:, :, :: side - 1] = 0
        return out


def spline_basis(level: int) -> np.ndarray:
    """A cubic B-spline with knots 2^level nodes apart at the nodes around it, (2·reach + 1,)."""
    values = np.ones(1)
    for _ in range(level):
        spread = np.zeros(2 * len(values) - 1)
        spread[::2] = values
        values = np.convolve(spread, np.array([1, 4, 6, 4, 1]) / 8)
    return values.astype(np.float32)
