"""λv of a sparse scan, by how well the surface foretells points that it has not seen.

Generalised cross-validation (Golub, Heath, Wahba, "Generalized cross-validation as a method for
choosing a good ridge parameter", Technometrics 1979). Were each of m points left out in turn, the
surface of the others would miss it by about

    √(1/m Σ f(q)²) / (1 − tr A/m)

where A says how f at the points follows the points. Its trace takes one solve of the Gauss-Newton
system, with a random sign for each point on the right (Hutchinson, 1989). The mean is without the
few points, mostly at creases, that are missed by far more than others: they ask for ever less λv.
"""

from __future__ import annotations

import math

import numpy as np

from visco_core.energy import Energy, Linearisation
from visco_core.grid.samples import at_corners, corner_weights
from visco_core.kernels import Array
from visco_core.presets import FAR_OFF, GREATEST_VISCOSITY, LEAST_VISCOSITY, ROUGHNESS
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
    probe, least = _probe(energy, seed), (ROUGHNESS / energy.grid.resolution) ** 2
    best, first = energy.weights.viscosity, _missed(energy, state.at, probe, pace)
    near = first < FAR_OFF**2 * np.median(first)

    def mean(missed: np.ndarray) -> float:
        # Errors below what trilinear voxels make of exact points tell nothing of finer ones.
        return max(float(missed[near].mean()), least)

    error = mean(first)
    for factor in (STEP, 1 / STEP):
        moved = False
        while not pace.late() and (viscosity := _bounded(factor * best)) != best:
            other = energy.with_viscosity(weight=viscosity)
            found = minimise(solver, other, begin, pace, lambda _: None)
            missed = mean(_missed(other, found.at, probe, pace))
            if pace.late() or missed > (1 - GAIN) ** 2 * error:
                break
            moved, best, error, state = True, viscosity, missed, found
        if moved:
            break
    return best, state


def _bounded(viscosity: float) -> float:
    return min(max(viscosity, LEAST_VISCOSITY), GREATEST_VISCOSITY)


def _missed(energy: Energy, at: Linearisation, probe: np.ndarray, pace: Pace) -> np.ndarray:
    """(P,): the squares of what points are missed by if left out, in units of the cube."""
    grid, weight, samples = energy.grid, energy.weights.point, energy.samples
    backend = grid.backend
    pushed = energy.scattered(backend.array(probe * np.float32(weight / samples.total)))
    answer, _ = conjugate_gradients(energy, at, pushed, INNER_STEPS, TOLERANCE, pace)
    followed = backend.kernels.dot(pushed, answer) / weight
    away, _ = corner_weights(backend.numpy(samples.local))
    f = np.einsum("pc,pc->p", at_corners(grid, samples, at.values), away)
    missed: np.ndarray = np.square(f / max(1 - followed, 1e-3))
    return missed


def _probe(energy: Energy, seed: int) -> np.ndarray:
    """(M, 8) float32: a voxel's trilinear weights, summed over its points with a sign for each."""
    numpy, samples = energy.grid.backend.numpy, energy.samples
    local, starts = numpy(samples.local), numpy(samples.starts)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(local)).astype(np.float32)
    weights, _ = corner_weights(local)
    sums: np.ndarray = np.add.reduceat(signs[:, None] * weights, starts[:-1])
    return sums
