"""STL, binary and text: the corners of the triangles, each position once."""

from __future__ import annotations

import re
import struct

import numpy as np

from visco_core.errors import InputError
from visco_core.io.faces import surface_points
from visco_core.io.source import PointHeader, Source, no_points, require_bytes, require_points
from visco_core.io.table import parse_table
from visco_core.pointcloud import PointCloud

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 84
_TEXT = re.compile(rb"\s*solid\b[^\n]*\n\s*(facet|endsolid)\b", re.IGNORECASE)
_FACET = re.compile(rb"^\s*facet\s", re.IGNORECASE | re.MULTILINE)
_CORNER = re.compile(rb"^\s*vertex[ \t]+([^\r\n]*)", re.IGNORECASE | re.MULTILINE)
_END = re.compile(rb"(^|\n)\s*endsolid\b[^\n]*\s*\Z", re.IGNORECASE)


def is_stl(source: Source) -> bool:
    """Text by its first words, binary by its length: there is no other mark."""
    promised = _promised_bytes(source)
    fits = promised == source.size if source.exact else promised <= source.size
    return _is_text(source) or fits


def sniff(source: Source) -> PointHeader:
    """The count is None because triangles share corners: the file's length bounds it."""
    if _is_text(source):
        return PointHeader("stl", "ascii", None, has_normals=True)
    promised = _promised_bytes(source)
    require_bytes(promised, source.size, "triangles")
    if source.exact and source.size - promised >= _TRIANGLE.itemsize:
        raise InputError(
            "excess_data",
            f"{source.size - promised:,} bytes follow after the triangles that the header "
            "promises; mend or export the file again.",
        )
    return PointHeader("stl", "binary", None if promised > _HEAD else 0, has_normals=True)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The corners, with normals from the triangles' order; the file's own normals are ignored.

    Raises InputError (``truncated_file``, ``excess_data``, ``unreadable_file``, ``no_points``,
    ``too_many_points``).
    """
    corners = read_corners(source)
    cloud = surface_points(corners, np.arange(len(corners)).reshape(-1, 3))
    require_points(len(cloud), max_points)
    return cloud


def read_corners(source: Source) -> np.ndarray:
    """(3 F, 3) float64: the corners of one triangle after the other; raises as ``read`` does."""
    header = sniff(source)
    if header.points == 0:
        raise no_points()
    if header.encoding == "binary":
        count = (_promised_bytes(source) - _HEAD) // _TRIANGLE.itemsize
        triangles = np.fromfile(source.file, _TRIANGLE, count, offset=_HEAD)
        with np.errstate(invalid="ignore"):
            return triangles["corners"].reshape(-1, 3).astype(np.float64)
    return _read_text(source.read_all())


def _read_text(text: bytes) -> np.ndarray:
    facets, corners = len(_FACET.findall(text)), _CORNER.findall(text)
    if len(corners) != 3 * facets or not _END.search(text[-4096:]):
        raise InputError(
            "truncated_file",
            f"The STL text has {len(corners):,} corners for {facets:,} triangles or does not end "
            "with endsolid; copy or export it again.",
        )
    if not facets:
        raise no_points()
    return parse_table(b"\n".join(corners), len(corners), 3)


def _is_text(source: Source) -> bool:
    return _TEXT.match(source.head) is not None


def _promised_bytes(source: Source) -> int:
    count = source.read(_HEAD - 4, 4)
    if count is None:
        return _HEAD
    return _HEAD + _TRIANGLE.itemsize * struct.unpack("<I", count)[0]
