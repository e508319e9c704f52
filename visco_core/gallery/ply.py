"""Scans of the gallery as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visco_core.pointcloud import PointCloud


def encode_scan(cloud: PointCloud) -> bytes:
    """The scan as a binary little-endian PLY: float32 coordinates and normals, uint8 colors."""
    columns = dict(zip(("x", "y", "z"), cloud.points.astype("<f4").T, strict=True))
    if cloud.normals is not None:
        columns |= dict(zip(("nx", "ny", "nz"), cloud.normals.astype("<f4").T, strict=True))
    if cloud.colors is not None:
        columns |= dict(zip(("red", "green", "blue"), cloud.colors.T, strict=True))
    rows = np.empty(len(cloud), dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    kinds = {"f": "float", "u": "uchar"}
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(rows)}",
        *(f"property {kinds[column.dtype.kind]} {name}" for name, column in columns.items()),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii") + rows.tobytes()


def write_scan(cloud: PointCloud, path: str | Path) -> Path:
    """Write ``encode_scan`` to ``path``, and return it."""
    path = Path(path)
    path.write_bytes(encode_scan(cloud))
    return path
