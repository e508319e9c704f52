"""The coarea loss."""

from __future__ import annotations

from visco_core.kernels.native import library


def coarea(values, neighbours, slabs, flags, resolution, beta, scale, out):
    nodes = neighbours, len(neighbours), slabs, len(slabs) - 1, flags
    return library.coarea(values, *nodes, resolution, beta, scale, out)
