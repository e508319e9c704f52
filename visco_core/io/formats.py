"""Which reader a file gets: by its first bytes, and by its name only where those say nothing."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from visco_core.errors import InputError
from visco_core.io.source import HEAD_BYTES, PointHeader, Source, require_points
from visco_core.pointcloud import PointCloud


class _Reader(Protocol):
    sniff: Callable[[Source], PointHeader]
    read: Callable[[Source, int | None], PointCloud]


_MAGIC = {
    b"ply": "ply",
    b"ASTM-E57": "e57",
    b"LASF": "las",
    b"\x93NUMPY": "npz",
    b"PK\x03\x04": "npz",
    b"PK\x05\x06": "npz",
}
_SUFFIXES = {
    ".ply": "ply",
    ".e57": "e57",
    ".las": "las",
    ".laz": "las",
    ".npz": "npz",
    ".npy": "npz",
    ".pcd": "pcd",
    ".stl": "stl",
    ".obj": "obj",
    ".xyz": "xyz",
    ".pts": "xyz",
    ".txt": "xyz",
    ".csv": "xyz",
    ".asc": "xyz",
}


def read_points(path: str | Path, *, max_points: int | None = None) -> PointCloud:
    """The scan in a PLY, XYZ, PTS, TXT, CSV, OBJ, STL, PCD, LAS, LAZ, E57, NPZ or NPY file.

    Mesh files give their vertices, with normals from their faces where they bring none. What the
    header promises is checked against the file's length, and against ``max_points``, before
    anything is allocated. Raises InputError with a stable code: ``unreadable_file``,
    ``not_a_point_cloud``, ``truncated_file``, ``excess_data``, ``no_points``,
    ``too_many_points``, ``unsupported_property``, ``suspicious_compression``.
    """
    source = Source.of_file(path)
    cloud = _reader(source).read(source, max_points)
    require_points(len(cloud), max_points)
    return cloud


def sniff_points(
    source: str | Path | bytes,
    size: int | None = None,
    *,
    exact: bool = True,
    name: str = "",
    max_points: int | None = None,
) -> PointHeader:
    """What a file says about itself, checked against its length; reads no point.

    source: a path, or the file's first bytes (all, or at least ``HEAD_BYTES``); size: the whole
    file's length in bytes, needed with bytes; exact: whether it is that, or only a bound above it;
    name: the file's name, for formats that have no mark of their own. Cheap enough for a web
    service: imports neither torch nor any format's library.
    Raises InputError as ``read_points`` does.
    """
    if isinstance(source, bytes):
        total = len(source) if size is None else size
        given = Source(source[:HEAD_BYTES], total, name, exact=exact)
    else:
        given = Source.of_file(source)
    header = _reader(given).sniff(given)
    require_points(header.points, max_points)
    return header


def _reader(source: Source) -> _Reader:
    return cast(_Reader, import_module(f"visco_core.io.{_format(source)}"))


def _format(source: Source) -> str:
    if not source.size:
        raise InputError("no_points", "The file is empty; export the scan again.")
    head = source.head
    for magic, name in _MAGIC.items():
        if head.startswith(magic) and (name != "ply" or head[3:4] in (b"\n", b"\r", b" ", b"")):
            return name
    # The modules below decide by more than a fixed mark.
    from visco_core.io import obj, pcd, stl, xyz

    if pcd.is_pcd(head):
        return "pcd"
    if stl.is_stl(source):
        return "stl"
    if obj.is_obj(head):
        return "obj"
    if xyz.looks_like_rows(head):
        return "xyz"
    if source.suffix in _SUFFIXES:
        return _SUFFIXES[source.suffix]
    raise InputError(
        "not_a_point_cloud",
        "The file is no point cloud that can be read; "
        "give a scan as PLY, XYZ, PTS, OBJ, STL, PCD, LAS, LAZ, E57 or NPZ.",
    )
