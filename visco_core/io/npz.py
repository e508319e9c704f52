"""Arrays saved by numpy: NPZ with points, normals and colours, or one NPY table."""

from __future__ import annotations

import ast
import io
import re
import struct
import zipfile
from dataclasses import dataclass

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble, to_bytes, to_float32
from visco_core.io.source import (
    PointHeader,
    Source,
    decoding,
    require_bytes,
    require_points,
    unreadable,
)
from visco_core.pointcloud import PointCloud

_KEYS = {
    "points": ("points", "xyz", "vertices", "verts", "positions", "pos", "coords", "p", "arr_0"),
    "normals": ("normals", "normal", "vertex_normals", "nrm", "n"),
    "colors": ("colors", "colours", "color", "rgb", "vertex_colors", "c"),
}
_COLUMNS = {"points": (3, 6), "normals": (3,), "colors": (3, 4)}
_HEADER_BYTES = 4096
# Nested brackets exhaust the parser of literals before they exhaust these bytes.
_HEADER_ERRORS = (
    *(ValueError, KeyError, TypeError, IndexError, struct.error, SyntaxError),
    *(RecursionError, MemoryError),
)
# Scans shrink by 2 to 10; a thousand is what deflate does to zeros.
_MOST_EXPANSION = 100
_ALWAYS_FINE_BYTES = 1 << 26


@dataclass(frozen=True)
class _Array:
    """What the beginning of an NPY file says: rows, columns, and bytes with the header."""

    rows: int
    columns: int
    bytes: int


def sniff(source: Source) -> PointHeader:
    if source.head.startswith(b"\x93NUMPY"):
        array = _parse_npy(source.head)
        if array.columns not in _COLUMNS["points"]:
            raise _unsupported("The array of points has an unexpected shape")
        require_bytes(array.bytes, source.size, f"{array.rows:,} rows")
        return PointHeader("npy", "npy", array.rows, array.columns >= 6)
    if source.path is None and len(source.head) < source.size:
        return PointHeader("npz", "zip", None)
    arrays = {role: array for role, (_, array) in _find_arrays(source).items()}
    normals = "normals" in arrays or arrays["points"].columns == 6
    return PointHeader("npz", "zip", arrays["points"].rows, normals, "colors" in arrays)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The points from an array (P, 3) or, with normals, (P, 6); NPZ may hold those apart.

    NPZ keys: ``points`` (or xyz, vertices, positions, ...), ``normals`` and ``colors``. Pickled
    objects are refused. Raises InputError (``truncated_file``, ``unreadable_file``,
    ``suspicious_compression``, ``unsupported_property``, ``no_points``, ``too_many_points``).
    """
    header = sniff(source)
    require_points(header.points, max_points)
    if header.format == "npy":
        with decoding("NPY"), source.file.open("rb") as file:
            table = np.load(file, allow_pickle=False)
        return _from_arrays({"points": table})
    members = {role: name for role, (name, _) in _find_arrays(source).items()}
    with decoding("NPZ"), zipfile.ZipFile(source.file) as archive:
        arrays = {role: _load_member(archive, name) for role, name in members.items()}
    return _from_arrays(arrays)


def _load_member(archive: zipfile.ZipFile, name: str) -> np.ndarray:
    with archive.open(name) as member:
        return np.lib.format.read_array(member, allow_pickle=False)


def _from_arrays(arrays: dict[str, np.ndarray]) -> PointCloud:
    table = arrays["points"]
    columns = {name: table[:, i] for i, name in enumerate(("x", "y", "z"))}
    if table.shape[1] == 6:
        columns |= {name: table[:, i + 3] for i, name in enumerate(("nx", "ny", "nz"))}
    cloud = assemble(columns)
    normals = to_float32(arrays["normals"]) if "normals" in arrays else cloud.normals
    colors = to_bytes(arrays["colors"][:, :3]) if "colors" in arrays else None
    return PointCloud(cloud.points, normals, colors)


def _find_arrays(source: Source) -> dict[str, tuple[str, _Array]]:
    """role -> name in the archive and header, all of one length; ``points`` is always there."""
    with decoding("NPZ"), zipfile.ZipFile(source.path or io.BytesIO(source.head)) as archive:
        members = {info.filename: info for info in archive.infolist()}
        found = {}
        for role, keys in _KEYS.items():
            name = next((k + ".npy" for k in keys if k + ".npy" in members), None)
            if name:
                found[role] = (name, _check_member(archive, members[name]))
    if "points" not in found:
        raise InputError(
            "not_a_point_cloud",
            "The archive has no array called points; save it with points and, if known, normals.",
        )
    rows = found["points"][1].rows
    for role, (_, array) in found.items():
        if array.rows != rows or array.columns not in _COLUMNS[role]:
            raise _unsupported(f"The array of {role} has an unexpected shape")
    _check_expansion([members[name] for name, _ in found.values()], source.size)
    return found


def _check_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> _Array:
    with archive.open(info) as member:
        array = _parse_npy(member.read(_HEADER_BYTES))
    require_bytes(array.bytes, info.file_size, f"{array.rows:,} rows")
    return array


def _check_expansion(members: list[zipfile.ZipInfo], size: int) -> None:
    unpacked = sum(info.file_size for info in members)
    packed = min(sum(info.compress_size for info in members), size)
    if unpacked > max(_ALWAYS_FINE_BYTES, _MOST_EXPANSION * packed):
        raise InputError(
            "suspicious_compression",
            f"The archive would grow from {packed:,} to {unpacked:,} bytes, which no scan does; "
            "save it uncompressed.",
        )


def _parse_npy(head: bytes) -> _Array:
    """Source: numpy, NEP 1, a simple file format for numpy arrays."""
    try:
        version, length = head[6], struct.unpack_from("<H", head, 8)[0]
        begin = 10
        if version >= 2:
            begin, length = 12, struct.unpack_from("<I", head, 8)[0]
        if head[:6] != b"\x93NUMPY" or begin + length > _HEADER_BYTES:
            raise ValueError(version)
        described = ast.literal_eval(head[begin : begin + length].decode("latin-1").strip())
        shape, descr = described["shape"], described["descr"]
        code = re.fullmatch(r"[<>|=]?([fiub])(\d+)", descr) if isinstance(descr, str) else None
        rows, columns = (int(n) for n in shape) if len(shape) == 2 else (-1, -1)
    except _HEADER_ERRORS as error:
        raise unreadable("The header of the numpy array is damaged") from error
    if code is None or columns not in (3, 4, 6) or rows < 0:
        raise _unsupported("The array is no table of numbers with 3 or 6 columns")
    return _Array(rows, columns, begin + length + rows * columns * int(code.group(2)))


def _unsupported(problem: str) -> InputError:
    return InputError("unsupported_property", f"{problem}; save points and normals as (P, 3).")
