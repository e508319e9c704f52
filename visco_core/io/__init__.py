"""Reading scans, and writing and reading meshes: one reader or writer a file."""

from visco_core.io.formats import read_points, sniff_points
from visco_core.io.mesh import MESH_FORMATS, check_output, read_mesh, write_mesh
from visco_core.io.source import HEAD_BYTES, PointHeader

__all__ = [
    "HEAD_BYTES",
    "MESH_FORMATS",
    "PointHeader",
    "check_output",
    "read_mesh",
    "read_points",
    "sniff_points",
    "write_mesh",
]
