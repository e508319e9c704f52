"""Points as text: XYZ, PTS, TXT, CSV and the like, one point a line."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from visco_core.errors import InputError
from visco_core.io.columns import assemble, find_roles
from visco_core.io.source import PointHeader, Source, require_points
from visco_core.io.table import parse_table, split_lines
from visco_core.pointcloud import PointCloud

_PREAMBLE_LINES = 100
_NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf)\Z", re.IGNORECASE)
_LINE_END = re.compile(rb"\r\n|\n|\r")
_COMMENTS = ("#", "//", "%", "!")
_MARK = b"\xef\xbb\xbf"
_SAMPLE = 20_000


@dataclass(frozen=True)
class _Layout:
    """What stands before the first row, and how rows are written.

    ``names`` is empty where there is no header line; ``count`` is None where no line holds one.
    """

    begin: int
    names: tuple[str, ...]
    count: int | None
    columns: int
    separator: str
    decimal_comma: bool


def sniff(source: Source) -> PointHeader:
    layout = _find_layout(source.head)
    if layout.count is not None:
        _require_rows(layout.count, (source.size - layout.begin) // (2 * layout.columns) + 1)
    roles = find_roles(layout.names)
    return PointHeader("xyz", "ascii", layout.count, "nx" in roles, "red" in roles)


def looks_like_rows(head: bytes) -> bool:
    """Whether ``head`` is text that comes to a row of at least three numbers."""
    try:
        _find_layout(head)
    except InputError:
        return False
    return True


def read(source: Source, max_points: int | None = None) -> PointCloud:
    """The points; columns by their names where there is a header line, else by what they hold.

    Blanks, commas or semicolons separate; with semicolons or blanks a comma may be the decimal
    point. Without names: x y z first, then in any order unit normals, colours (whole numbers up to
    255 or 65535, or shares up to 1) and scalars; ``_name_columns`` has the details.

    Raises InputError (``unreadable_file``, ``truncated_file``, ``excess_data``, ``no_points``,
    ``too_many_points``, ``not_a_point_cloud``).
    """
    data = source.read_all()
    layout = _find_layout(data[: len(source.head)])
    text, offsets = split_lines(_with_blanks(data[layout.begin :], layout))
    rows = len(offsets) - 1
    require_points(rows, max_points)
    if layout.count is not None:
        _require_rows(layout.count, rows)
        if rows > layout.count:
            raise InputError(
                "excess_data",
                f"The first line promises {layout.count:,} points but {rows:,} rows follow; "
                "correct it or export the file again.",
            )
    table = parse_table(text, rows)
    names = layout.names
    if len(names) != table.shape[1]:
        names = _name_columns(table, intensity_first=layout.count is not None)
    return assemble({name: table[:, i] for i, name in enumerate(names)})


def _find_layout(head: bytes) -> _Layout:
    """Comments, a count and one line of titles may come before the first row, in any order."""
    if b"\0" in head:
        raise _no_rows()
    titles: list[str] = []
    count = None
    begin = len(_MARK) if head.startswith(_MARK) else 0
    for _ in range(_PREAMBLE_LINES):
        end = _LINE_END.search(head, begin)
        line = head[begin : end.start() if end else len(head)].decode("latin-1").strip()
        separator, decimal_comma = _separator(line)
        words = [w for w in re.split(rf"[{separator}\s]+", line) if w]
        if len(words) >= 3 and all(_NUMBER.match(w.replace(",", ".")) for w in words):
            if titles and len(titles) != len(words):
                break
            names = tuple(titles) if all(axis in find_roles(titles) for axis in "xyz") else ()
            return _Layout(begin, names, count, len(words), separator, decimal_comma)
        if len(words) == 1 and words[0].isdecimal() and len(words[0]) < 16:
            count = int(words[0])
        elif words and (found := _titles(line)):
            titles = found
        elif words and not line.startswith(_COMMENTS):
            break
        if end is None:
            break
        begin = end.end()
    raise _no_rows()


def _titles(line: str) -> list[str]:
    """The words of a line that could name columns, each once; empty for a plain comment."""
    words = [w.strip("\"'[]()") for w in re.split(r"[,;\s]+", line.lstrip("#/%! \t"))]
    words = [w for w in words if w]
    names = [w if words.index(w) == i else f"{w} {i + 1}" for i, w in enumerate(words)]
    named = all(axis in find_roles(names) for axis in "xyz")
    return names if named or not line.startswith(_COMMENTS) else []


def _separator(line: str) -> tuple[str, bool]:
    """The separator besides blanks, ``;`` or ``,`` or none, and whether commas are decimal."""
    if ";" in line:
        return ";", "," in line
    words = line.split()
    inner = [w for w in words if "," in w.strip(",")]
    if len(words) >= 3 and inner and not any(w.endswith(",") for w in words):
        return "", True
    return ",", False


def _with_blanks(data: bytes, layout: _Layout) -> bytes:
    """``data`` with blanks between the numbers and without comment lines."""
    if layout.separator == ";":
        data = data.replace(b";", b" ")
    if layout.decimal_comma:
        data = data.replace(b",", b".")
    elif layout.separator == ",":
        data = data.replace(b",", b" ")
    if re.search(rb"[#/]", data):
        data = re.sub(rb"(?m)^[ \t]*(#|//).*$", b"", data)
    return data


def _name_columns(table: np.ndarray, intensity_first: bool) -> tuple[str, ...]:
    """Names for unnamed columns (P, C), from what they hold.

    After x y z, each triple that looks like unit normals or like colours is one, anything else is a
    scalar. PTS files (those with a count line) have the intensity before the colours. Three
    columns that alone follow x y z and fit neither are normals of other lengths.
    """
    columns = table.shape[1]
    sample = table[:: max(1, len(table) // _SAMPLE)]
    names = ["x", "y", "z"]
    if columns == 7 and intensity_first and _is_color(sample[:, 4:7]):
        return (*names, "intensity", "red", "green", "blue")
    while len(names) < columns:
        at = len(names)
        triple = sample[:, at : at + 3]
        if triple.shape[1] == 3 and "nx" not in names and _is_unit(triple):
            names += ["nx", "ny", "nz"]
        elif triple.shape[1] == 3 and "red" not in names and _is_color(triple):
            names += ["red", "green", "blue"]
        elif columns == 6 and at == 3:
            names += ["nx", "ny", "nz"]
        else:
            names.append("intensity" if columns in (4, 7, 10) else f"scalar {at - 2}")
    return tuple(names)


def _is_unit(triples: np.ndarray) -> bool:
    lengths = np.linalg.norm(triples, axis=1)
    lengths = lengths[lengths > 0]
    return bool(len(lengths)) and bool(np.median(np.abs(lengths - 1)) < 0.02)


def _is_color(triples: np.ndarray) -> bool:
    known = triples[np.isfinite(triples).all(axis=1)]
    if not len(known) or known.min() < 0:
        return False
    return bool(known.max() <= 1 or (known.max() <= 65535 and (known == np.rint(known)).all()))


def _require_rows(promised: int, found: int) -> None:
    if found < promised:
        raise InputError(
            "truncated_file",
            f"The first line promises {promised:,} points but at most {found:,} follow; "
            "copy or export the file again.",
        )


def _no_rows() -> InputError:
    return InputError(
        "not_a_point_cloud",
        "The file has no rows of at least three numbers; "
        "give a scan as PLY, XYZ, PTS, OBJ, STL, PCD, LAS, LAZ, E57 or NPZ.",
    )
