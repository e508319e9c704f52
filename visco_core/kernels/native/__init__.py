"""Compiled CPU kernels: the twins of ``reference``, one for one, on numpy arrays.

Shapes and meanings are given there; these functions only make room for results and call ``src``.
Every sum over nodes is taken in blocks of fixed size and added up in order, so that results do not
depend on the number of threads; sums into nodes that several voxels share go by i-slab, so that no
two threads write to one node.
"""

from __future__ import annotations

import numpy as np

from visco_core.kernels.native import library
from visco_core.kernels.native.coarea_loss import coarea
from visco_core.kernels.native.points import (
    point_matvec,
    point_sums,
    point_system,
    scatter,
)
from visco_core.kernels.native.splines import (
    spline_correct,
    spline_energies,
    spline_prolong,
    spline_restrict,
)
from visco_core.kernels.native.start import (
    splat_divergence,
    squared_distance,
)
from visco_core.kernels.native.support import support
from visco_core.kernels.native.surface import (
    surface_counts,
    surface_faces,
    surface_vertices,
)
from visco_core.kernels.native.topology import (
    find_nodes,
    free_runs,
    neighbour_table,
    refine,
    voxel_corners,
)
from visco_core.kernels.native.vectors import (
    adam_advance,
    cg_advance,
    cg_direction,
    dot,
    sample,
)
from visco_core.kernels.native.viscosity import (
    linearise,
    operate,
    viscosity_columns,
    viscosity_diagonal,
)

__all__ = [
    "adam_advance",
    "cg_advance",
    "cg_direction",
    "coarea",
    "dot",
    "find_nodes",
    "free_runs",
    "linearise",
    "neighbour_table",
    "operate",
    "point_matvec",
    "point_sums",
    "point_system",
    "refine",
    "sample",
    "scatter",
    "splat_divergence",
    "spline_correct",
    "spline_energies",
    "spline_prolong",
    "spline_restrict",
    "squared_distance",
    "support",
    "surface_counts",
    "surface_faces",
    "surface_vertices",
    "viscosity_columns",
    "viscosity_diagonal",
    "voxel_corners",
]


def set_threads(count: int) -> int:
    """How many threads the calls of this thread may use from now on; returns how many before."""
    return library.set_threads(count)


def label_pieces(faces: np.ndarray, vertices: int) -> np.ndarray:
    """(V,) int32: which connected piece of the mesh each vertex is of, numbered from 0.

    faces (F, 3) int32.
    """
    labels = np.empty(vertices, np.int32)
    library.label_pieces(faces, len(faces), vertices, labels)
    return labels
