"""E57, the exchange format of terrestrial scanners: several scans, each with its pose."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from importlib import import_module
from typing import Any
from xml.etree import ElementTree

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble
from visco_core.io.source import (
    PointHeader,
    Source,
    decoding,
    require_bytes,
    require_points,
    unreadable,
)
from visco_core.pointcloud import PointCloud

_MAGIC = b"ASTM-E57"
_MOST_XML_BYTES = 1 << 26
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
_COLORS = ("colorRed", "colorGreen", "colorBlue")
_INVALID = ("cartesianInvalidState", "sphericalInvalidState")


def sniff(source: Source) -> PointHeader:
    """Source: ASTM E2807-11, sections 7 and 8 and table 5.

    The count is None where only the file's beginning is at hand, since it stands near the end.
    """
    root = _read_xml(source)
    if root is None:
        return PointHeader("e57", "e57", None)
    points = 0
    names: set[str] = set()
    for count, prototype in _point_lists(root):
        bits = sum(_bits(entry) for entry in prototype)
        if count > 1 and bits == 0:
            raise unreadable("The E57 points are declared without any data")
        require_bytes(count * bits // 8, source.size, f"{count:,} points")
        points += count
        names.update(_local_name(entry) for entry in prototype)
    return PointHeader("e57", "e57", points, "normalX" in names, _COLORS[0] in names)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The valid points of all scans, each moved by its pose, with colours and intensity.

    Normals and colours are kept where every scan has them. Raises InputError
    (``truncated_file``, ``unreadable_file``, ``no_points``, ``too_many_points``,
    ``unsupported_property``).
    """
    require_points(sniff(source).points, max_points)
    import pye57

    with decoding("E57"), pye57.E57(str(source.file)) as file:
        scans = [_read_scan(file, index) for index in range(file.scan_count)]
    scans = [scan for scan in scans if len(scan["x"])]
    require_points(sum(len(scan["x"]) for scan in scans), max_points)
    common = [name for name in scans[0] if all(name in scan for scan in scans)]
    return assemble({name: np.concatenate([scan[name] for scan in scans]) for name in common})


def _read_scan(file: Any, index: int) -> dict[str, np.ndarray]:
    header = file.get_header(index)
    fields = list(header.point_fields)
    if not header.point_count:
        return {"x": np.empty(0)}
    coordinates = next((c for c in (_CARTESIAN, _SPHERICAL) if set(c) <= set(fields)), None)
    if coordinates is None:
        raise InputError(
            "unsupported_property",
            "An E57 scan has no coordinates; export it with x, y and z.",
        )
    groups = (_COLORS, _NORMALS, ("intensity",))
    extras = [name for group in groups if set(group) <= set(fields) for name in group]
    states = [name for name in _INVALID if name in fields]
    data = _read_fields(file, header, [*coordinates, *extras, *states])
    valid = np.all([data[name] == 0 for name in states], axis=0) if states else slice(None)
    data = {name: values[valid] for name, values in data.items()}

    points = np.stack([data[name] for name in coordinates], axis=1)
    if coordinates is _SPHERICAL:
        points = _from_spherical(points)
    rotation = header.rotation_matrix
    points = points @ rotation.T + header.translation
    columns = {axis: points[:, i] for i, axis in enumerate("xyz")}
    if set(_NORMALS) <= data.keys():
        normals = np.stack([data.pop(name) for name in _NORMALS], axis=1) @ rotation.T
        columns |= {name: normals[:, i] for i, name in enumerate(("nx", "ny", "nz"))}
    return columns | {name: data[name] for name in extras if name in data}


def _read_fields(file: Any, header: Any, names: list[str]) -> dict[str, np.ndarray]:
    """All values of some fields, as float64 whatever their range: pye57's own types are narrow."""
    libe57: Any = import_module("pye57.libe57")
    count = header.point_count
    data = {name: np.empty(count) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name, values in data.items():
        buffers.append(libe57.SourceDestBuffer(file.image_file, name, values, count, True, True))
    reader = header.points.reader(buffers)
    found = reader.read()
    reader.close()
    if found != count:
        raise InputError(
            "truncated_file",
            f"An E57 scan holds {found:,} of its {count:,} points; copy or export it again.",
        )
    return data


def _from_spherical(points: np.ndarray) -> np.ndarray:
    """x y z of range, azimuth and elevation in radians."""
    distance, azimuth, elevation = points.T
    level = distance * np.cos(elevation)
    return np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )


def _read_xml(source: Source) -> ElementTree.Element | None:
    fixed = source.read(0, 48)
    if fixed is None or not fixed.startswith(_MAGIC):
        raise unreadable("The E57 header is cut off")
    length, offset, xml_bytes, page = struct.unpack_from("<QQQQ", fixed, 16)
    require_bytes(length, source.size, "pages")
    payload = page - 4
    if page < 64 or page > 1 << 20 or xml_bytes > _MOST_XML_BYTES:
        raise unreadable("The E57 header is damaged")
    pages = offset % page + xml_bytes + 4 * (xml_bytes // payload + 2)
    if offset + xml_bytes > source.size:
        require_bytes(offset + xml_bytes, source.size, "a description")
    if source.path is None and offset + pages > len(source.head):
        return None
    start = offset - offset % page
    raw = source.read(start, min(source.size - start, pages + page)) or b""
    logical = b"".join(raw[at : at + payload] for at in range(0, len(raw), page))
    try:
        return ElementTree.fromstring(logical[offset % page :][:xml_bytes])
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise unreadable("The description inside the E57 file is damaged") from error


def _point_lists(root: ElementTree.Element) -> Iterator[tuple[int, list[ElementTree.Element]]]:
    """Count and fields of every scan."""
    scans = next((child for child in root if _local_name(child) == "data3D"), None)
    for scan in scans if scans is not None else ():
        for points in scan:
            if _local_name(points) == "points":
                count = points.get("recordCount", "0")
                prototype = [p for p in points if _local_name(p) == "prototype"]
                if not count.isdecimal() or len(count) > 15 or not prototype:
                    raise unreadable("The description inside the E57 file is damaged")
                yield int(count), list(prototype[0])


def _bits(entry: ElementTree.Element) -> int:
    """Bits that one value of a field takes: integers are packed to their range."""
    kind = entry.get("type")
    if kind == "Float":
        return 32 if entry.get("precision") == "single" else 64
    try:
        low = int(entry.get("minimum", str(-(2**63))))
        high = int(entry.get("maximum", str(2**63 - 1)))
    except ValueError as error:
        raise unreadable("The description inside the E57 file is damaged") from error
    return math.ceil(math.log2(high - low + 1)) if high > low else 0


def _local_name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]
