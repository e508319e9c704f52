"""PLY in all its forms."""

from __future__ import annotations

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble, find_roles
from visco_core.io.faces import check_faces, fan_triangles, vertex_normals
from visco_core.io.ply_header import Element, PlyHeader, parse_ply_header, sniff
from visco_core.io.ply_rows import Rows, binary_rows, text_rows
from visco_core.io.source import Source, no_points, require_points
from visco_core.io.table import split_lines
from visco_core.pointcloud import PointCloud

__all__ = ["read", "read_with_faces", "sniff"]

_CORNERS = ("vertex_indices", "vertex_index")


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The vertices as points; without normals in the file, its faces give them.

    Raises InputError (``truncated_file``, ``excess_data``, ``unreadable_file``, ``no_points``,
    ``too_many_points``, ``unsupported_property``).
    """
    cloud, faces = read_with_faces(source, max_points, only_for_normals=True)
    if cloud.normals is None and len(faces):
        normals = vertex_normals(cloud.points, faces)
        return PointCloud(cloud.points, normals, cloud.colors, cloud.scalars)
    return cloud


def read_with_faces(
    source: Source, max_points: int | None = None, *, only_for_normals: bool = False
) -> tuple[PointCloud, np.ndarray]:
    """The vertices, and the faces as triangles (F, 3) int64; raises as ``read`` does.

    only_for_normals: leave the faces out where the vertices bring normals of their own.
    """
    header = parse_ply_header(source)
    vertex = header.vertex
    if vertex is None:
        raise no_points()
    require_points(vertex.count, max_points)
    wanted = [e for e in header.elements if e is vertex or _corners(e)]
    if only_for_normals and "nx" in find_roles(p.name for p in vertex.properties):
        wanted = [vertex]
    rows = (_read_text if header.text else _read_binary)(source, header, wanted)
    cloud = assemble(rows[wanted.index(vertex)].scalars)
    triangles = [
        fan_triangles(*found.lists[_corners(element)])
        for element, found in zip(wanted, rows, strict=True)
        if element is not vertex
    ]
    faces = np.concatenate([np.empty((0, 3), np.int64), *triangles])
    check_faces(faces, len(cloud))
    return cloud, faces


def _corners(element: Element) -> str:
    """The list that holds the corners of a face; empty where the element is no face."""
    lists = [p.name for p in element.properties if p.count_type and p.type[0] != "f"]
    return next((n for n in lists if element.name == "face" and n in _CORNERS), "")


def _read_text(source: Source, header: PlyHeader, wanted: list[Element]) -> list[Rows]:
    text, offsets = split_lines(source.read_all()[header.body :])
    promised, found = sum(e.count for e in header.elements), len(offsets) - 1
    if found != promised:
        code, advice = ("truncated_file", "copy") if found < promised else ("excess_data", "mend")
        raise InputError(
            code,
            f"The header promises {promised:,} rows but {found:,} follow; "
            f"{advice} or export the file again.",
        )
    rows = []
    line = 0
    for element in header.elements:
        if element in wanted:
            rows.append(text_rows(text[offsets[line] : offsets[line + element.count]], element))
        line += element.count
    return rows


def _read_binary(source: Source, header: PlyHeader, wanted: list[Element]) -> list[Rows]:
    rows = []
    offset = header.body
    for element in header.elements:
        found, offset = binary_rows(source, header.byte_order, element, offset)
        if element in wanted:
            rows.append(found)
        if len(rows) == len(wanted) and element is not header.elements[-1]:
            return rows
    left = source.size - offset
    if header.vertex and left >= header.vertex.least_row_bytes(text=False):
        raise InputError(
            "excess_data",
            f"{left:,} bytes follow after the last row that the header promises; "
            "mend or export the file again.",
        )
    return rows
