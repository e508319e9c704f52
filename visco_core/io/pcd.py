"""PCD, the format of the Point Cloud Library: text, binary and compressed binary."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble, find_roles, require_coordinates
from visco_core.io.source import (
    PointHeader,
    Source,
    decoding,
    require_bytes,
    require_points,
    unreadable,
)
from visco_core.io.table import parse_table, split_lines, whole_numbers
from visco_core.pointcloud import PointCloud

_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_ENCODINGS = ("ascii", "binary", "binary_compressed")
_BEGIN = re.compile(rb"(?:[ \t]*(?:#[^\r\n]*)?\r?\n)*(?:VERSION|FIELDS|COLUMNS)[ \t]")
_MOST_VALUES_A_POINT = 10_000
# The longest run that LZF can write takes 3 bytes for 264.
_MOST_LZF_EXPANSION = 88


@dataclass(frozen=True)
class _Header:
    """fields: (name, numpy type code, values a point); the rows begin at byte ``body``."""

    fields: tuple[tuple[str, str, int], ...]
    points: int
    encoding: str
    body: int

    @property
    def row_bytes(self) -> int:
        return sum(int(code[1:]) * count for _, code, count in self.fields)

    @property
    def values(self) -> int:
        return sum(count for _, _, count in self.fields)


def is_pcd(head: bytes) -> bool:
    return _BEGIN.match(head) is not None


def sniff(source: Source) -> PointHeader:
    header = _parse_header(source)
    names = [name for name, _, count in header.fields if count == 1]
    roles = find_roles(names)
    require_coordinates(roles)
    colors = "red" in roles or "rgb" in names or "rgba" in names
    return PointHeader("pcd", header.encoding, header.points, "nx" in roles, colors)


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The points; fields of several values a point are left out.

    Raises InputError (``truncated_file``, ``excess_data``, ``unreadable_file``, ``no_points``,
    ``too_many_points``, ``unsupported_property``).
    """
    require_points(sniff(source).points, max_points)
    header = _parse_header(source)
    columns = (_read_text if header.encoding == "ascii" else _read_binary)(source, header)
    columns.pop("_", None)
    for packed in ("rgb", "rgba"):
        if packed in columns:
            bits = columns.pop(packed).astype(_packed_type(header, packed)).view(np.uint32)
            for shift, name in ((16, "red"), (8, "green"), (0, "blue")):
                columns[name] = ((bits >> shift) & 255).astype(np.uint8)
    return assemble(columns)


def _packed_type(header: _Header, name: str) -> str:
    """Colours are packed into 32 bits, which PCL also calls a float."""
    code = next(code for field, code, _ in header.fields if field == name)
    return "f4" if code[0] == "f" else "u4"


def _parse_header(source: Source) -> _Header:
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = source.head.find(b"\n", at)
        if end < 0:
            raise unreadable("The PCD header has no DATA line")
        words = source.head[at:end].decode("latin-1").split("#")[0].split()
        at = end + 1
        if words:
            entries[words[0].upper()] = words[1:]
    try:
        header = _checked_header(entries, at)
    except (KeyError, ValueError, IndexError) as error:
        raise unreadable("The PCD header is incomplete or contradicts itself") from error
    _check_promise(source, header)
    return header


def _checked_header(entries: dict[str, list[str]], body: int) -> _Header:
    names = entries.get("FIELDS") or entries["COLUMNS"]
    counts = [int(c) for c in entries.get("COUNT", ["1"] * len(names))]
    fields = []
    for name, size, kind, count in zip(
        names, entries["SIZE"], entries["TYPE"], counts, strict=True
    ):
        if int(size) not in _SIZES[kind] or not 0 < count <= _MOST_VALUES_A_POINT:
            raise ValueError(name)
        fields.append((name, kind.lower() + size, count))
    points = int(entries["WIDTH"][0]) * int(entries.get("HEIGHT", ["1"])[0])
    points = int(entries.get("POINTS", [str(points)])[0])
    encoding = entries["DATA"][0].lower()
    named = [name for name in names if name != "_"]
    if points < 0 or encoding not in _ENCODINGS or len(set(named)) != len(named):
        raise ValueError(encoding)
    return _Header(tuple(fields), points, encoding, body)


def _check_promise(source: Source, header: _Header) -> None:
    left = source.size - header.body
    what = f"{header.points:,} points"
    if header.encoding == "ascii":
        require_bytes(2 * header.values * header.points - 1, left, what)
    elif header.encoding == "binary":
        require_bytes(header.row_bytes * header.points, left, what)
    elif header.points:
        sizes = source.read(header.body, 8)
        if sizes is None:
            require_bytes(8, left, what)
            return
        packed, unpacked = np.frombuffer(sizes, "<u4").tolist()
        require_bytes(packed, left - 8, what)
        if unpacked != header.row_bytes * header.points or unpacked > _MOST_LZF_EXPANSION * packed:
            raise unreadable("The compressed part is not of the size that the PCD header promises")


def _read_text(source: Source, header: _Header) -> dict[str, np.ndarray]:
    text, offsets = split_lines(source.read_all()[header.body :])
    found = len(offsets) - 1
    if found != header.points:
        code = "truncated_file" if found < header.points else "excess_data"
        raise InputError(
            code,
            f"The header promises {header.points:,} points but {found:,} rows follow; "
            "copy or export the file again.",
        )
    table = parse_table(text, header.points, header.values)
    columns = {}
    at = 0
    for name, code, count in header.fields:
        if count > 1:
            at += count
            continue
        columns[name] = table[:, at] if code[0] == "f" else whole_numbers(table[:, at])
        at += count
    return columns


def _read_binary(source: Source, header: _Header) -> dict[str, np.ndarray]:
    """Decoded behind a header written anew, so that the decoder sees what was checked."""
    from pypcd4.pypcd4 import PointCloud as PcdFile

    data = source.read_all()[header.body :]
    left = len(data) - header.points * header.row_bytes
    if header.encoding == "binary" and left >= header.row_bytes:
        raise InputError(
            "excess_data",
            f"{left:,} bytes follow after the points that the header promises; "
            "mend or export the file again.",
        )
    lines = {
        "VERSION": ["0.7"],
        "FIELDS": [f"f{i}" for i in range(len(header.fields))],
        "SIZE": [code[1:] for _, code, _ in header.fields],
        "TYPE": [code[0].upper() for _, code, _ in header.fields],
        "COUNT": [str(count) for _, _, count in header.fields],
        "WIDTH": [str(header.points)],
        "HEIGHT": ["1"],
        "POINTS": [str(header.points)],
        "DATA": [header.encoding],
    }
    text = "".join(f"{key} {' '.join(values)}\n" for key, values in lines.items())
    with decoding("PCD"):
        file: Any = io.BytesIO(text.encode() + data)
        rows = PcdFile.from_fileobj(file).pc_data
    return {name: rows[f"f{i}"] for i, (name, _, count) in enumerate(header.fields) if count == 1}
