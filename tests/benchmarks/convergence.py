"""Energy against time on the coarsest level: ``python -m tests.benchmarks.convergence --data DIR``.

Every solver starts from the same field and minimises the same energy, that of 64³ voxels with the
scan's own weights. Its time is the solver's alone; the energy is always that of the asked ε. The
last column is when the energy of the plain solver's 60 × 40 steps was reached.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import zoom

from tests.benchmarks.srb import add_data_arguments, data_cases
from tests.benchmarks.tables import Cell, markdown_table
from visco_core.clock import Clock
from visco_core.continuation import continuation
from visco_core.energy import Energy
from visco_core.frame import Normalisation
from visco_core.grid.samples import locate, spatial_order
from visco_core.grid.topology import dense_grid
from visco_core.initial import starting_values
from visco_core.io import read_points
from visco_core.kernels import Array, Backend, choose_backend
from visco_core.noise import estimate_noise
from visco_core.normals import estimate_normals
from visco_core.pointcloud import PointCloud
from visco_core.presets import SMOOTHED, Weights, weights_for_noise
from visco_core.rims import are_planes
from visco_core.solvers.gauss_newton import GaussNewton, GaussNewtonState
from visco_core.solvers.loop import Pace

SECONDS = (0.05, 0.1, 0.2, 0.4)
"""When the energy is shown."""

CLOSE = 1e-4
"""An energy that is reached to this share of itself counts as reached."""

Trace = list[tuple[float, int, float]]
"""Seconds, iterations and energy after each outer step."""


@dataclass(frozen=True)
class Diagonal(GaussNewton):
    """Preconditioned by the operator's diagonal alone."""

    def init(self, energy: Energy, values: Array) -> GaussNewtonState:
        return replace(super().init(energy, values), coarser=None)


@dataclass(frozen=True)
class LineSearch(GaussNewton):
    """Takes the best of five lengths of each step instead of the first that is downhill."""

    def step(self, energy: Energy, state: GaussNewtonState, pace: Pace) -> GaussNewtonState:
        delta, used = self._solve(energy, state, pace)
        lengths = (np.float32(length) for length in (0.25, 0.5, 0.75, 1.0, 1.5))
        trials = [energy.linearise(state.values + length * delta) for length in lengths]
        best = min([state.at, *trials], key=lambda at: at.total)
        return replace(
            state,
            at=best,
            steps=state.steps + 1,
            work=state.work + used,
            converged=best is state.at,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_arguments(parser)
    parser.add_argument("--work", type=Path, default=Path("out/bench"), help="keeps the scans")
    arguments = parser.parse_args()
    for case in data_cases(arguments):
        level = Level(read_points(case.scan), choose_backend("native", "cpu", None))
        traces = {name: solve(level) for name, solve in SOLVERS.items()}
        header = ["solver", *(f"{seconds:g} s" for seconds in SECONDS)]
        header += ["at the end", "iterations", "seconds", "plain 60 × 40 after"]
        print(f"\n{case.name}, energy / 1e-6\n\n{markdown_table(header, list(_rows(traces)))}")


def _rows(traces: dict[str, Trace]) -> Iterator[list[Cell]]:
    aim = (1 + CLOSE) * traces[PLAIN][-1][2]
    for name, trace in traces.items():
        seconds, iterations, energy = trace[-1]
        shown = [_energy_at(trace, at) for at in SECONDS]
        reached = next((f"{at:.2f} s" for at, _, found in trace if found <= aim), "never")
        yield [name, *shown, f"{energy * 1e6:.4f}", str(iterations), f"{seconds:.2f}", reached]


def _energy_at(trace: Trace, seconds: float) -> str:
    found = [energy for at, _, energy in trace if at <= seconds]
    return f"{found[-1] * 1e6:.4f}" if found else "-"


class Level:
    """The coarsest level of a scan: its energy and start at any number of voxels."""

    def __init__(self, cloud: PointCloud, backend: Backend) -> None:
        points = Normalisation.of(cloud.points).to_cube(cloud.points)
        order = spatial_order(points)
        self.backend, self.points = backend, points[order]
        if cloud.normals is None:
            self.normals = estimate_normals(self.points)
        else:
            self.normals = cloud.normals[order]
        noise = estimate_noise(self.points, self.normals, SMOOTHED)
        planes = are_planes(self.points, self.normals)
        self.weights: Weights = weights_for_noise(noise, [64], shared=planes)[0]

    def energy(self, voxels: int = 64) -> Energy:
        grid = dense_grid(self.backend, voxels + 1)
        return Energy(grid, locate(grid, self.points, self.normals), self.weights)

    def start(self, voxels: int = 64) -> Array:
        values = starting_values(self.backend, self.points, self.normals, voxels)
        return self.backend.array(values)


def _solved(level: Level, solver: GaussNewton) -> Trace:
    """From the level's own start."""
    return _traced(level.energy(), [(1.0, solver)], level.start())[0]


def _continued(level: Level) -> Trace:
    """As the profile ``fast`` goes through ε, less its extrapolation."""
    return _traced(level.energy(), continuation(1.0, 4, 30), level.start())[0]


def _nested(level: Level) -> Trace:
    """From the solution with half the voxels, which a start of its own led to."""
    coarse, values = _traced(level.energy(32), [(1.0, GaussNewton(4, 30))], level.start(32))
    dense = level.backend.numpy(values)[:-1].reshape(33, 33, 33)
    finer = np.append(np.asarray(zoom(dense, 65 / 33, order=1)), 0).astype(np.float32)
    fine, _ = _traced(level.energy(), [(1.0, GaussNewton(10, 30))], level.backend.array(finer))
    (seconds, _, _) = coarse[-1]
    return [(seconds + at, iterations, energy) for at, iterations, energy in fine]


def _traced(
    energy: Energy, stages: list[tuple[float, GaussNewton]], values: Array
) -> tuple[Trace, Array]:
    """The trace of solvers that follow one another, each at a multiple of ε, and the solution."""
    pace, asked = Clock(time.monotonic()), energy.weights.viscosity_epsilon
    trace: Trace = []
    seconds, work = 0.0, 0
    for factor, solver in stages:
        begun, within = time.perf_counter(), energy.with_viscosity(epsilon=factor * asked)
        state = solver.init(within, values)
        while not solver.done(state):
            state = solver.step(within, state, pace)
            seconds += time.perf_counter() - begun
            trace.append((seconds, work + state.work, energy.linearise(state.values).total))
            begun = time.perf_counter()
        values, work = state.values, work + state.work
    return trace, values


PLAIN, OURS = "diagonal, 60 × 40", "BPX, 8ε to ε, 11 × 30"
SOLVERS: dict[str, Callable[[Level], Trace]] = {
    PLAIN: lambda level: _solved(level, Diagonal(60, 40, 0.0, 0.0)),
    "diagonal, 10 to 1 %": lambda level: _solved(level, Diagonal(10, 400, 1e-2, 0.0)),
    "BPX, 5 × 30": lambda level: _solved(level, GaussNewton(5, 30, outer_tolerance=0.0)),
    "BPX, 10 × 15": lambda level: _solved(level, GaussNewton(10, 15, outer_tolerance=0.0)),
    "BPX, 10 × 30": lambda level: _solved(level, GaussNewton(10, 30, outer_tolerance=0.0)),
    "BPX, 20 × 30": lambda level: _solved(level, GaussNewton(20, 30, outer_tolerance=0.0)),
    "BPX, 10 × 30, line search": lambda level: _solved(level, LineSearch(10, 30)),
    "BPX, from 33³, 10 × 30": _nested,
    OURS: _continued,
}


if __name__ == "__main__":
    main()
