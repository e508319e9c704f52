"""What the starting field is made of."""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library


def splat_divergence(points, vectors, cells):
    out = np.zeros((cells, cells, cells), np.float32)
    library.splat_divergence(points, vectors, len(points), cells, out)
    return out


def squared_distance(region):
    out = np.empty(region.shape, np.float32)
    library.squared_distance(region.view(np.uint8), len(region), out)
    return out
