"""Adam on sampled voxels, for the profile ``paper`` (section 4 of the paper).

Every iteration samples a share of the active nodes and voxels, and the points in sampled voxels;
each loss is scaled by one over the share, so that its expected gradient is the full one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visco_core.energy import Energy
from visco_core.kernels import Array
from visco_core.solvers.loop import Pace

ITERATIONS_PER_STEP = 100
"""How many iterations make a step: one full evaluation of the losses and one report."""

BETA1, BETA2, TINY = 0.9, 0.999, 1e-8


@dataclass(frozen=True)
class AdamState:
    """``mean`` and ``square`` are the running moments; a step updates them in place."""

    values: Array
    losses: dict[str, float]
    mean: Array
    square: Array
    steps: int = 0
    work: int = 0


@dataclass(frozen=True)
class Adam:
    iterations: int
    batch_fraction: float
    learning_rate: float
    seed: int

    @property
    def steps(self) -> int:
        return -(-self.iterations // ITERATIONS_PER_STEP)

    @property
    def work(self) -> int:
        return self.iterations

    def init(self, energy: Energy, values: Array) -> AdamState:
        zeros = energy.grid.backend.zeros
        return AdamState(values, {}, zeros(*values.shape), zeros(*values.shape))

    def step(self, energy: Energy, state: AdamState, pace: Pace) -> AdamState:
        values = state.values + 0
        work = state.work
        for _ in range(min(ITERATIONS_PER_STEP, self.iterations - state.work)):
            pace.check()
            gradient = energy.sampled_gradient(values, self.batch_fraction, self.seed + work)
            work += 1
            energy.grid.backend.kernels.adam_advance(
                values,
                gradient,
                state.mean,
                state.square,
                np.float32(self.learning_rate / (1 - BETA1**work)),
                np.float32(1 - BETA2**work),
                np.float32(BETA1),
                np.float32(BETA2),
                np.float32(TINY),
            )
            if pace.late():
                break
        losses = energy.linearise(values).losses
        return AdamState(values, losses, state.mean, state.square, state.steps + 1, work)

    def done(self, state: AdamState) -> bool:
        return state.work >= self.iterations
