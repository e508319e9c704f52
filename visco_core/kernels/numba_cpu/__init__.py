"""Compiled CPU kernels: the twins of ``reference``, one for one, on numpy arrays.

Shapes and meanings are given there. Every sum over nodes is taken in blocks of fixed size and added
up in order, so that results do not depend on the number of threads; sums into nodes that several
voxels share go by i-slab, even slabs first, so that no two threads write to one node.
"""

from __future__ import annotations

from visco_core.kernels.numba_cpu.coarea_loss import coarea
from visco_core.kernels.numba_cpu.points import (
    point_matvec,
    point_sums,
    point_system,
    scatter,
)
from visco_core.kernels.numba_cpu.splines import (
    spline_energies,
    spline_prolong,
    spline_restrict,
)
from visco_core.kernels.numba_cpu.start import (
    splat,
    squared_distance,
)
from visco_core.kernels.numba_cpu.support import support
from visco_core.kernels.numba_cpu.surface import (
    surface_counts,
    surface_faces,
    surface_vertices,
)
from visco_core.kernels.numba_cpu.topology import (
    find_nodes,
    free_runs,
    neighbour_table,
    refine,
    voxel_corners,
)
from visco_core.kernels.numba_cpu.vectors import (
    adam_advance,
    cg_advance,
    cg_direction,
    dot,
    sample,
)
from visco_core.kernels.numba_cpu.viscosity import (
    linearise,
    viscosity_columns,
    viscosity_diagonal,
    viscosity_rows,
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
    "point_matvec",
    "point_sums",
    "point_system",
    "refine",
    "sample",
    "scatter",
    "splat",
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
    "viscosity_rows",
    "voxel_corners",
]
