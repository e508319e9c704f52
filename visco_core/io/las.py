"""LAS and LAZ, the formats of airborne and terrestrial laser scans."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble, find_roles
from visco_core.io.laz import check_chunks
from visco_core.io.source import PointHeader, Source, decoding, require_bytes, require_points
from visco_core.pointcloud import PointCloud

if TYPE_CHECKING:
    import laspy

_CHUNK_BYTES = 1 << 26
_COLOR_FORMATS = (2, 3, 5, 7, 8, 10)
_COMPRESSED = 0xC0
_RECORD_BYTES = 54
# A LAZ file of scanned points has 2 to 10 bytes a point; this only stops decompression bombs.
_MOST_LAZ_POINTS_A_BYTE = 4


@dataclass(frozen=True)
class _Header:
    compressed: bool
    colors: bool
    points: int
    row_bytes: int
    data_begin: int


def sniff(source: Source) -> PointHeader:
    header = _parse_header(source)
    kind = "laz" if header.compressed else "las"
    return PointHeader("las", kind, header.points, has_colors=header.colors)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The points with scaled coordinates, 16-bit colours as 8 bits, and intensity.

    Extra dimensions named as normals (NormalX and so on) are the normals. Raises InputError
    (``truncated_file``, ``unreadable_file``, ``no_points``, ``too_many_points``).
    """
    header = _parse_header(source)
    require_points(header.points, max_points)
    if header.compressed:
        check_chunks(
            source,
            points=header.points,
            row_bytes=header.row_bytes,
            data_begin=header.data_begin,
        )
    import laspy

    parts: list[dict[str, np.ndarray]] = []
    with decoding("LAS"), source.file.open("rb") as stream:
        file = laspy.LasReader(stream, read_evlrs=False)
        # In pieces, so that memory follows what was decoded and not what the header says.
        chunks = file.chunk_iterator(max(1, _CHUNK_BYTES // header.row_bytes))
        parts.extend(_columns(chunk) for chunk in chunks)
    if sum(len(part["x"]) for part in parts) != header.points:
        raise InputError(
            "truncated_file",
            f"Fewer points follow than the {header.points:,} that the header promises; "
            "copy or export the file again.",
        )
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if "red" in columns and not any(columns[c].any() for c in ("red", "green", "blue")):
        for color in ("red", "green", "blue"):
            del columns[color]
    return assemble(columns)


def _parse_header(source: Source) -> _Header:
    """Source of the offsets: ASPRS, LAS Specification 1.4 R15, table 3."""
    fixed = source.read(0, 227)
    if fixed is None:
        raise _damaged("is shorter than a LAS header")
    major, minor, header_bytes, data_begin, records = struct.unpack_from("<BB68xHII", fixed, 24)
    kind, row_bytes, points = struct.unpack_from("<BHI", fixed, 104)
    if (major, minor) >= (1, 4):
        extended = source.read(247, 8)
        if extended is None or header_bytes < 375:
            raise _damaged("is shorter than its LAS 1.4 header")
        points = struct.unpack("<Q", extended)[0]
    known = major == 1 and minor <= 4 and row_bytes >= 20
    if not known or data_begin < header_bytes + records * _RECORD_BYTES:
        raise _damaged("has an impossible LAS header")
    compressed = bool(kind & _COMPRESSED)
    left = source.size - data_begin
    least = -(-points // _MOST_LAZ_POINTS_A_BYTE) if compressed else points * row_bytes
    require_bytes(least, left, f"{points:,} points")
    colors = (kind & ~_COMPRESSED) in _COLOR_FORMATS
    return _Header(compressed, colors, points, row_bytes, data_begin)


def _columns(chunk: laspy.ScaleAwarePointRecord) -> dict[str, np.ndarray]:
    names = [str(name) for name in chunk.array.dtype.names or ()]
    roles = find_roles(names)
    columns = {axis: np.array(chunk[axis], np.float64) for axis in "xyz"}
    for role in ("nx", "ny", "nz", "red", "green", "blue"):
        if role in roles:
            columns[role] = np.array(chunk[roles[role]])
    columns["intensity"] = np.array(chunk["intensity"])
    return columns


def _damaged(what: str) -> InputError:
    return InputError("unreadable_file", f"The file {what}; copy or export it again.")
