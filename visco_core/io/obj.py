"""OBJ: the vertices of a mesh, or of a point cloud.

Read by hand because trimesh cuts all vertices to the length of the shortest line, so that one
damaged line loses a coordinate of every point in silence. Materials and textures are never opened.
"""

from __future__ import annotations

import re

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import to_bytes, to_float32
from visco_core.io.faces import check_faces, fan_triangles, surface_points
from visco_core.io.source import PointHeader, Source, require_points, unreadable
from visco_core.io.table import parse_table
from visco_core.pointcloud import PointCloud

_VERTEX = re.compile(rb"^[ \t]*v[ \t]+([^\r\n]*)", re.MULTILINE)
_NORMAL = re.compile(rb"^[ \t]*vn[ \t]+([^\r\n]*)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n]*)", re.MULTILINE)
_STATEMENT = re.compile(rb"[ \t]*(v|vn|vt|vp|f|p|l|o|g|s|mtllib|usemtl|usemap|mg)[ \t]")


def is_obj(head: bytes) -> bool:
    """Whether the first line that is neither blank nor a comment is an OBJ statement."""
    for line in head.splitlines():
        if line.strip() and not line.lstrip().startswith(b"#"):
            return _STATEMENT.match(line) is not None and b"\0" not in line
    return False


def sniff(source: Source) -> PointHeader:
    normals = _NORMAL.search(source.head) or _FACE.search(source.head)
    return PointHeader("obj", "ascii", None, has_normals=normals is not None)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The vertices with normals from the faces, each position once; else as they stand.

    Raises InputError (``unreadable_file``, ``truncated_file``, ``no_points``,
    ``too_many_points``).
    """
    cloud, faces = read_with_faces(source, max_points)
    return surface_points(cloud.points, faces, cloud.colors) if len(faces) else cloud


def read_with_faces(source: Source, max_points: int | None = None) -> tuple[PointCloud, np.ndarray]:
    """The vertices, and the faces as triangles (F, 3) int64; raises as ``read`` does.

    ``vn`` lines are normals where there is one a vertex and no face. Three numbers after a
    vertex are its colour.
    """
    data = source.read_all().replace(b"\\\n", b" ").replace(b"\\\r\n", b" ")
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    lines = _VERTEX.findall(data)
    require_points(len(lines), max_points)
    vertices = parse_table(b"\n".join(lines), len(lines))
    if vertices.shape[1] < 3:
        raise unreadable("The vertices of the OBJ file have fewer than three coordinates")
    points, colors = np.ascontiguousarray(vertices[:, :3]), None
    if vertices.shape[1] in (6, 7):
        colors = to_bytes(vertices[:, -3:])
    faces = _faces(data)
    check_faces(faces, len(points))
    normals = None if len(faces) else _normals(data, len(points))
    return PointCloud(points, normals, colors), faces


def _normals(data: bytes, points: int) -> np.ndarray | None:
    lines = _NORMAL.findall(data)
    if len(lines) != points:
        return None
    return to_float32(parse_table(b"\n".join(lines), points, 3))


def _faces(data: bytes) -> np.ndarray:
    lines = _FACE.findall(data)
    text = re.sub(rb"/\S*", b"", b"\n".join(lines))
    try:
        table = parse_table(text, len(lines))
        counts, corners = np.full(len(table), table.shape[1]), table.ravel()
    except InputError:
        counts, corners = _differing_faces(text)
    if not np.all(np.abs(corners) < 2.0**53) or (corners == 0).any():
        raise unreadable("A face of the OBJ file has a corner that is no vertex")
    corners = corners.astype(np.int64)
    if (corners < 0).any():
        # A negative corner counts back from the last vertex above its line.
        above = np.searchsorted(
            [match.start() for match in _VERTEX.finditer(data)],
            [match.start() for match in _FACE.finditer(data)],
        )
        corners = np.where(corners < 0, np.repeat(above, counts) + corners + 1, corners)
    return fan_triangles(counts, corners - 1)


def _differing_faces(text: bytes) -> tuple[np.ndarray, np.ndarray]:
    rows = [line.split() for line in text.split(b"\n")]
    try:
        corners = np.array([word for row in rows for word in row], np.float64)
    except ValueError as error:
        raise unreadable("A face of the OBJ file cannot be read") from error
    return np.array([len(row) for row in rows]), corners
