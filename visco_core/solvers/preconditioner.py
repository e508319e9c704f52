"""What conjugate gradients are preconditioned with: the diagonal, and on a dense grid BPX.

BPX (Bramble, Pasciak, Xu, "Parallel multilevel preconditioners", Math. Comp. 1990) adds, to the
diagonal's correction, those of a few coarser grids:

    z = D₀⁻¹ r + Σ_l P_l D_l⁻¹ P_lᵀ r

The viscosity term is close to a biharmonic operator, for which trilinear prolongation is not smooth
enough; P_l are cubic B-splines. D_l is the energy of one spline: exact for the points, and for the
viscosity term averaged over the directions of n̂.
"""

from __future__ import annotations

import numpy as np

from visco_core.energy import Energy
from visco_core.kernels import Array

COARSER_GRIDS = 3


def inverse_diagonal(diagonal: Array) -> Array:
    """D₀⁻¹: one over the operator's diagonal (N + 1,), zero where that is zero."""
    return (diagonal > 0) / (diagonal + (diagonal == 0))


class Multilevel:
    """The corrections of the coarser grids, for an energy whose grid is dense.

    Built once, used for every linearisation.
    """

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

    def correct(self, residual: Array, z: Array) -> float:
        """z += Σ_l P_l D_l⁻¹ P_lᵀ residual, both (N + 1,); returns residual · z.

        The cube's rim is fixed and stays as it is.
        """
        side = self._grid.side
        restricted = [residual[:-1].reshape(side, side, side)]
        for _ in self._inverses:
            restricted.append(self._kernels.spline_restrict(restricted[-1]))
        total = restricted[-1] * self._inverses[-1]
        for inverse, r in zip(self._inverses[-2::-1], restricted[-2:0:-1], strict=True):
            total = inverse * r + self._kernels.spline_prolong(total, len(r))
        return self._kernels.spline_correct(total, side, residual, z)


def spline_basis(level: int) -> np.ndarray:
    """A cubic B-spline with knots 2^level nodes apart at the nodes around it, (2·reach + 1,)."""
    values = np.ones(1)
    for _ in range(level):
        spread = np.zeros(2 * len(values) - 1)
        spread[::2] = values
        values = np.convolve(spread, np.array([1, 4, 6, 4, 1]) / 8)
    return values.astype(np.float32)
