"""Gauss-Newton with conjugate gradients inside, for the profile ``fast``.

All losses but coarea are sums of squares. With n̂ = ∇̂f/‖∇̂f‖ and sign(f) held fixed a step solves

    (λv/N JᵀJ + λp/m PᵀP + λn/m GᵀG) δ = −½ ∂E/∂f

to a loose tolerance by preconditioned conjugate gradients, and halves δ until the energy does not
grow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from visco_core.energy import Energy, Linearisation
from visco_core.kernels import Array
from visco_core.solvers.loop import Pace
from visco_core.solvers.preconditioner import Multilevel, inverse_diagonal

HALVINGS = 4

LEAST_INNER_STEPS = 10
"""Fewer iterations than this would leave a step that is hardly worth its linearisation."""


@dataclass(frozen=True)
class GaussNewtonState:
    """``coarser`` corrects what the operator's diagonal makes of a residual, on a dense grid."""

    at: Linearisation
    coarser: Multilevel | None
    steps: int = 0
    work: int = 0
    converged: bool = False

    @property
    def values(self) -> Array:
        return self.at.values

    @property
    def losses(self) -> dict[str, float]:
        return self.at.losses


@dataclass(frozen=True)
class GaussNewton:
    """At most ``steps`` outer steps of at most ``inner_steps`` CG iterations each.

    CG stops at ``inner_tolerance`` of its first preconditioned residual, the outer loop when a step
    lowers the energy by less than ``outer_tolerance`` of itself.
    """

    steps: int
    inner_steps: int
    inner_tolerance: float = 3e-3
    outer_tolerance: float = 1e-5

    @property
    def work(self) -> int:
        return self.steps * self.inner_steps

    def init(self, energy: Energy, values: Array) -> GaussNewtonState:
        coarser = Multilevel(energy) if energy.grid.is_dense else None
        return GaussNewtonState(energy.linearise(values), coarser)

    def step(self, energy: Energy, state: GaussNewtonState, pace: Pace) -> GaussNewtonState:
        delta, used = self._solve(energy, state, pace)
        after = replace(state, steps=state.steps + 1, work=state.work + used)
        before = state.at.total
        for halving in range(HALVINGS + 1):
            trial = energy.linearise(state.values + np.float32(0.5**halving) * delta)
            pace.check()
            if trial.total <= before:
                small = before - trial.total < self.outer_tolerance * before
                return replace(after, at=trial, converged=small)
        return replace(after, converged=True)

    def done(self, state: GaussNewtonState) -> bool:
        return state.converged or state.steps >= self.steps

    def _solve(self, energy: Energy, state: GaussNewtonState, pace: Pace) -> tuple[Array, int]:
        """The step δ (N + 1,) and its iterations."""
        at, limits = state.at, (self.inner_steps, self.inner_tolerance)
        return conjugate_gradients(energy, at, -at.gradient, *limits, pace, state.coarser)


def conjugate_gradients(
    energy: Energy,
    at: Linearisation,
    right: Array,
    steps: int,
    tolerance: float,
    pace: Pace,
    coarser: Multilevel | None = None,
) -> tuple[Array, int]:
    """x (N + 1,) with H x = ``right``, H the operator of ``energy.matvec``, and the steps taken.

    Preconditioned by the diagonal and ``coarser``. Ends where the preconditioned residual has
    fallen to ``tolerance`` of its first, after ``steps``, or where the pace is late.
    """
    kernels, zeros = energy.grid.backend.kernels, energy.grid.backend.zeros
    inverse = inverse_diagonal(energy.diagonal(at))
    x, q = zeros(*right.shape), zeros(*right.shape)
    r = right + 0
    z = inverse * r
    rz = first = coarser.correct(r, z) if coarser else kernels.dot(r, z)
    p = z + 0
    for step in range(steps):
        pace.check()
        curvature = energy.matvec(at, p, q)
        if curvature <= 0:
            return x, step
        previous = rz
        rz = kernels.cg_advance(x, r, p, q, np.float32(rz / curvature), inverse, z)
        if coarser:
            rz = coarser.correct(r, z)
        enough = rz <= tolerance**2 * first
        if enough or (step >= LEAST_INNER_STEPS and pace.late()):
            return x, step + 1
        kernels.cg_direction(p, z, np.float32(rz / previous))
    return x, steps
