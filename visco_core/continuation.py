"""From a large ε to a small one on the coarsest level, and on to ε → 0."""

from __future__ import annotations

import math

import numpy as np

from visco_core.box_sum import box_sum
from visco_core.grid.samples import Samples
from visco_core.grid.topology import Grid
from visco_core.kernels import Array
from visco_core.solvers.gauss_newton import GaussNewton

CONTINUATION = ((8.0, 0.25), (4.0, 0.5), (2.0, 1.0), (1.0, 1.0))
"""ε on the coarsest level, in turn, as multiples of the asked one, and shares of the level's outer
steps. A larger ε leaves fewer local minima and moves the surface across holes in few steps;
starting at the asked ε ends higher. Two solutions tell where the next one lies, and the last two,
which need all the steps, where ε → 0 leads: see ``towards``."""

FARTHEST = 0.33
"""Voxels by which an extrapolation in ε may change a value."""

AROUND, DENSE = 17, 5.0
"""Voxels a side of the block that tells whether a node's surroundings are densely scanned, and the
points a voxel of a plane then holds."""


def continuation(epsilon: float, steps: int, inner_steps: int) -> list[tuple[float, GaussNewton]]:
    """Each ε of ``CONTINUATION`` and its solver, of a level with so many outer and inner steps."""
    return [
        (factor * epsilon, GaussNewton(math.ceil(share * steps), inner_steps))
        for factor, share in CONTINUATION
    ]


def towards(
    epsilon: float,
    last: tuple[float, Array],
    before: tuple[float, Array],
    freedom: Array,
    farthest: float,
) -> Array:
    """Where the solutions (ε, f) ``before`` and ``last`` lead at ``epsilon``, straight in √ε.

    At ε = 0 it is Richardson's extrapolation: the distance that the viscosity solutions tend to,
    without their leading error. In holes that shrinks no faster than √ε: where ε halves, solutions
    move by 0.6 to 0.9 of what they moved before. Each node goes as far as its ``freedom`` (N + 1,)
    says and no value changes by more than ``farthest``: where solutions differ by much, at thin
    edges that the scan half shows, a straight line would make spikes.
    """
    far, near, there = (math.sqrt(each) for each in (before[0], last[0], epsilon))
    share = (near - there) / (far - near)
    step = np.float32(share) * freedom * (last[1] - before[1])
    return last[1] + step.clip(-farthest, farthest)


def freedom_of(grid: Grid, samples: Samples) -> Array:
    """(N + 1,) float32 in [0, 1]: how far a node of the dense ``grid`` may be extrapolated.

    Not at all in a voxel with points: what differs there between two solutions is their noise. All
    the way in a hole of a dense scan, where the voxels around hold as many points as ``DENSE`` in
    each voxel of a plane would make. A sparse scan is full of gaps that are no holes.
    """
    backend, side = grid.backend, grid.side
    corners, starts = backend.numpy(samples.corners), backend.numpy(samples.starts)
    counts = np.bincount(corners[:, 0], np.diff(starts), side**3).reshape(side, side, side)
    around = box_sum(counts, AROUND)
    freedom = np.append(np.minimum(around / (DENSE * AROUND**2), 1), 0).astype(np.float32)
    freedom[corners] = 0
    return backend.array(freedom)
