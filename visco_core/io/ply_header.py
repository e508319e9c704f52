"""The header of a PLY file, and what it promises.

Read by hand because every later step hangs on it: the same bytes are checked against the file's
length and then decoded, so that no second parser can see another promise in them. Source: Greg
Turk, The PLY Polygon File Format, 1994.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from visco_core.errors import InputError
from visco_core.io.columns import find_roles, require_coordinates
from visco_core.io.source import HEAD_BYTES, PointHeader, Source, require_bytes, unreadable

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_POINT_ELEMENTS = ("vertex", "vertices", "point", "points")
_MAX_COUNT = 1 << 48


@dataclass(frozen=True)
class Property:
    """``type`` and ``count_type`` are numpy codes; ``count_type`` is None unless it is a list."""

    name: str
    type: str
    count_type: str | None = None


@dataclass(frozen=True)
class Element:
    """One kind of row. ``lists``: some property is a list, so rows may differ in length."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def lists(self) -> bool:
        return any(p.count_type for p in self.properties)

    def least_row_bytes(self, text: bool) -> int:
        """The fewest bytes that a row can have: in text a digit and a separator a value."""
        if text:
            return 2 * len(self.properties)
        return sum(int((p.count_type or p.type)[1:]) for p in self.properties)


@dataclass(frozen=True)
class PlyHeader:
    """``byte_order`` is ``<``, ``>`` or, for text, empty; rows begin at byte ``body``."""

    encoding: str
    elements: tuple[Element, ...]
    body: int

    @property
    def byte_order(self) -> str:
        return _ENCODINGS[self.encoding]

    @property
    def text(self) -> bool:
        return self.encoding == "ascii"

    @property
    def vertex(self) -> Element | None:
        return next((e for e in self.elements if e.name.lower() in _POINT_ELEMENTS), None)


def parse_ply_header(source: Source) -> PlyHeader:
    """The header, its promise checked against the length of the file.

    Raises InputError (``unreadable_file``, ``truncated_file``, ``unsupported_property``).
    """
    lines, body = _header_lines(source)
    encoding, elements = _parse_lines(lines)
    header = PlyHeader(encoding, elements, body)
    promised = sum(e.count * e.least_row_bytes(header.text) for e in elements)
    if header.text:
        promised -= 1
    counts = " and ".join(f"{e.count:,} {e.name} rows" for e in elements if e.count)
    require_bytes(promised, source.size - body, counts)
    return header


def sniff(source: Source) -> PointHeader:
    header = parse_ply_header(source)
    vertex = header.vertex
    if vertex is None:
        return PointHeader("ply", header.encoding, 0)
    roles = find_roles(p.name for p in vertex.properties if not p.count_type)
    if vertex.count:
        require_coordinates(roles)
    return PointHeader("ply", header.encoding, vertex.count, "nx" in roles, "red" in roles)


def _header_lines(source: Source) -> tuple[list[str], int]:
    """The lines between ``ply`` and ``end_header``, and where the rows begin."""
    start = re.match(rb"ply[ \t]*(\r\n|\n|\r)", source.head)
    newline = start.group(1) if start else b"\n"
    end = re.search(newline + rb"[ \t]*end_header[ \t\r]*?(?:" + newline + rb"|\Z)", source.head)
    if not start or not end:
        if source.size > HEAD_BYTES:
            raise unreadable(f"The PLY header does not end within {HEAD_BYTES:,} bytes")
        raise InputError(
            "truncated_file", "The PLY header has no end_header line; copy or export it again."
        )
    text = source.head[start.end() : max(end.start(), start.end())].decode("latin-1")
    return re.split(r"\r\n|\n|\r", text), end.end()


def _parse_lines(lines: list[str]) -> tuple[str, tuple[Element, ...]]:
    encoding = ""
    elements: list[tuple[str, int, list[Property]]] = []
    for line in lines:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, *_] if name in _ENCODINGS and not encoding:
                encoding = name
            case ["element", name, count] if re.fullmatch(r"\d{1,15}", count):
                elements.append((name, int(count), []))
            case ["property", "list", count_type, item_type, name] if (
                elements and _TYPES.get(count_type, "f")[0] != "f" and item_type in _TYPES
            ):
                elements[-1][2].append(Property(name, _TYPES[item_type], _TYPES[count_type]))
            case ["property", item_type, name] if elements and item_type in _TYPES:
                elements[-1][2].append(Property(name, _TYPES[item_type]))
            case _:
                shown = ascii(line.strip()[:60])
                raise unreadable(f"The line {shown} does not belong into a PLY header")
    if not encoding:
        raise unreadable("The PLY header does not say its format")
    if len({name for name, _, _ in elements}) != len(elements):
        raise unreadable("The PLY header names an element twice")
    return encoding, tuple(_checked(Element(n, c, tuple(p))) for n, c, p in elements)


def _checked(element: Element) -> Element:
    names = [p.name for p in element.properties]
    if len(set(names)) != len(names):
        raise InputError(
            "unsupported_property",
            f"The PLY element {element.name!a} has two properties of one name; rename one.",
        )
    if element.count > _MAX_COUNT or (element.count and not names):
        raise unreadable(f"The PLY element {element.name!a} has impossible rows")
    return element
