"""λv of a sparse scan, by how well the surface foretells points that it has not seen.

Generalised cross-validation (Golub, Heath, Wahba, "Generalized cross-validation as a method for
choosing a good ridge parameter", Technometrics 1979). Were each of m points left out in turn, the
surface of the others would miss it by about

    √(1/m Σ f(q)²) / (1 − tr A/m)

where A says how f at the points follows the points. Its trace takes one solve of the Gauss-Newton
system, with a random sign for each point on the right (Hutchinson, 1989).
"""

from __future__ import annotations

import math

import numpy as np

from visco_core.energy import Energy, Linearisation
from visco_core.grid.samples import corner_weights
from visco_core.kernels import Array
from visco_core.presets import GREATEST_VISCOSITY, LEAST_VISCOSITY
from visco_core.solvers.gauss_newton import GaussNewtonState, conjugate_gradients
from visco_core.solvers.loop import Pace, Solver, minimise

STEP = math.sqrt(10)
"""Factor from one λv that is tried to the next."""

GAIN = 0.01
"""Share of the error that a step must take off: the trace is known no better."""

INNER_STEPS, TOLERANCE = 60, 1e-2
"""Of the trace's solve. Fewer steps make smooth surfaces seem to follow the points less."""


def choose_viscosity(
    energy: Energy,
    begin: Array,
    state: GaussNewtonState,
    solver: Solver[GaussNewtonState],
    pace: Pace,
    seed: int,
) -> tuple[float, GaussNewtonState]:
    """λv with which left out points are missed least, and the solution with it.

    ``state`` is what ``solver`` makes of ``begin`` (N + 1,) with the energy's own λv. From there it
    goes up or down by half decades for as long as the error falls, each time from ``begin``. Ends
    early where the pace is late; raises Stopped.
    """
    probe = _probe(energy, seed)
    best, error = energy.weights.viscosity, _error(energy, state.at, probe, pace)
    for factor in (STEP, 1 / STEP):
        moved = False
        while not pace.late() and _allowed(viscosity := factor * best):
            other = energy.with_viscosity(weight=viscosity)
            found = minimise(solver, other, begin, pace, lambda _: None)
            missed = _error(other, found.at, probe, pace)
            if pace.late() or missed > (1 - GAIN) * error:
                break
            moved, best, error, state = True, viscosity, missed, found
        if moved:
            break
    return best, state


def _allowed(viscosity: float) -> bool:
    return LEAST_VISCOSITY <= viscosity <= GREATEST_VISCOSITY


def _error(energy: Energy, at: Linearisation, probe: np.ndarray, pace: Pace) -> float:
    """By how much left out points are missed, in units of the cube."""
    backend, weight = energy.grid.backend, energy.weights.point
    pushed = energy.scattered(backend.array(probe * np.float32(weight / energy.samples.total)))
    answer, _ = conjugate_gradients(energy, at, pushed, INNER_STEPS, TOLERANCE, pace)
    followed = backend.kernels.dot(pushed, answer) / weight
    return math.sqrt(at.losses["point"] / weight) / max(1 - followed, 1e-3)


def _probe(energy: Energy, seed: int) -> np.ndarray:
    """(M, 8) float32: a voxel's trilinear weights, summed over its points with a sign for each."""
    numpy, samples = energy.grid.backend.numpy, energy.samples
    local, starts = numpy(samples.local), numpy(samples.starts)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(local)).astype(np.float32)
    weights, _ = corner_weights(local)
    sums: np.ndarray = np.add.reduceat(signs[:, None] * weights, starts[:-1])
    return sums
