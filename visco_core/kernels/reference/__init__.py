"""The kernels in plain torch, on CPU and CUDA: what each one computes, said as plainly as possible.

Shapes, shared by every backend: N nodes, M voxels that hold points, P points. A vector over nodes
has N + 1 entries; the last is always zero, and a missing neighbour points to it. A voxel's eight
corners are ordered 4·x + 2·y + z. ``flags`` is ROW where the viscosity loss has a row, FREE where
the value is unknown, ENCLOSED where all 26 nodes around are there.

    ijk (N, 3) int16, sorted        grid coordinates of the nodes
    columns (side² + 1,) int64      where each (i, j) column of nodes starts
    neighbours (N, 6) int32         −x, +x, −y, +y, −z, +z; N where there is none
    flags (N + 1,) uint8            bits ROW, FREE and ENCLOSED
    slopes (3, N + 1) float32       s·n̂ / 2h of the linearised viscosity row
    corners (M, 8) int32            nodes of the voxels that hold points
    matrices (M, 5, 8) float32      normal matrix A of a voxel's points, which is symmetric, by its
                                    cyclic diagonals: entry (k, r) is A[r, (r + k) mod 8]
    slabs (side + 1,) int64         where each i-slab of voxels starts in ``corners``
"""

from __future__ import annotations

from visco_core.kernels.reference.coarea_loss import coarea
from visco_core.kernels.reference.points import (
    point_matvec,
    point_sums,
    point_system,
    scatter,
)
from visco_core.kernels.reference.splines import (
    spline_correct,
    spline_energies,
    spline_prolong,
    spline_restrict,
)
from visco_core.kernels.reference.start import (
    splat_divergence,
    squared_distance,
)
from visco_core.kernels.reference.support import support
from visco_core.kernels.reference.surface import (
    surface_counts,
    surface_faces,
    surface_vertices,
)
from visco_core.kernels.reference.topology import (
    find_nodes,
    free_runs,
    neighbour_table,
    refine,
    voxel_corners,
)
from visco_core.kernels.reference.vectors import (
    adam_advance,
    cg_advance,
    cg_direction,
    dot,
    sample,
)
from visco_core.kernels.reference.viscosity import (
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
