"""Sums over blocks of cells."""

from __future__ import annotations

import numpy as np


def box_sum(cells: np.ndarray, width: int) -> np.ndarray:
    """At each cell of (a, b, c) the sum over the ``width``³ cells around it, ``width`` odd.

    Beyond the borders there is nothing. float64; numbers are added and taken away again, so whole
    numbers come out exactly.
    """
    sums = cells.astype(np.float64)
    for axis in range(3):
        running = np.cumsum(np.moveaxis(sums, axis, 0), axis=0)
        running = np.concatenate([np.zeros_like(running[:1]), running])
        middle, last = np.arange(len(running) - 1), len(running) - 1
        high = running[np.minimum(middle + width // 2 + 1, last)]
        sums = np.moveaxis(high - running[np.maximum(middle - width // 2, 0)], 0, axis)
    return np.ascontiguousarray(sums)
