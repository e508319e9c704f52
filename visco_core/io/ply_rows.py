"""The rows of one PLY element, as text or binary, with lists of equal or of differing length.

Decoded with numpy rather than plyfile: the header is parsed and checked before (ply_header.py says
why), and plyfile takes a second for 100,000 rows of text and for half a million faces, because it
builds every row as Python objects.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from visco_core.errors import InputError
from visco_core.io.ply_header import Element
from visco_core.io.source import Source, require_bytes, unreadable
from visco_core.io.table import parse_table, whole_numbers

_STRUCT = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}


@dataclass
class Rows:
    """scalars: name -> (N,); lists: name -> counts (N,) and all items in a row (sum of counts,)."""

    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def text_rows(text: bytes, element: Element) -> Rows:
    """The rows in ``text``, one a line.

    text: the element's lines, as ``split_lines`` leaves them. Raises InputError.
    """
    if not element.lists:
        table = parse_table(text, element.count, len(element.properties))
        columns = enumerate(element.properties)
        return Rows({p.name: _as_declared(table[:, i], p.type) for i, p in columns})
    return _equal_text_lists(text, element) or _differing_text_lists(text, element)


def _equal_text_lists(text: bytes, element: Element) -> Rows | None:
    """Rows that have nothing but one list of one length; None for all others."""
    if len(element.properties) != 1:
        return None
    try:
        table = parse_table(text, element.count)
    except InputError:
        return None
    length = table.shape[1] - 1
    if not len(table) or (table[:, 0] != length).any():
        return None
    items = element.properties[0]
    counts = np.full(len(table), length)
    return Rows(lists={items.name: (counts, _as_declared(table[:, 1:].ravel(), items.type))})


def _differing_text_lists(text: bytes, element: Element) -> Rows:
    scalars: dict[str, list[str]] = {p.name: [] for p in element.properties if not p.count_type}
    lists: dict[str, tuple[list[int], list[str]]] = {
        p.name: ([], []) for p in element.properties if p.count_type
    }
    for number, line in enumerate(text.splitlines(), start=1):
        words = iter(line.decode("latin-1").split())
        try:
            for p in element.properties:
                if p.count_type:
                    count = int(next(words))
                    items = list(islice(words, count))
                    if len(items) != count:
                        raise StopIteration
                    lists[p.name][0].append(count)
                    lists[p.name][1].extend(items)
                else:
                    scalars[p.name].append(next(words))
        except (StopIteration, ValueError) as error:
            raise unreadable(f"{element.name} row {number:,} is not as its header says") from error
    types = {p.name: p.type for p in element.properties}
    return Rows(
        {name: _words(values, types[name]) for name, values in scalars.items()},
        {
            name: (np.array(counts, np.int64), _words(items, types[name]))
            for name, (counts, items) in lists.items()
        },
    )


def _words(words: list[str], type_code: str) -> np.ndarray:
    try:
        return _as_declared(np.array(words, np.float64), type_code)
    except ValueError as error:
        raise unreadable("A word stands where a number should be") from error


def _as_declared(values: np.ndarray, type_code: str) -> np.ndarray:
    """Whole numbers where integers are declared; floats keep the digits that the text has."""
    if type_code[0] == "f":
        return values
    return whole_numbers(values)


def binary_rows(source: Source, order: str, element: Element, offset: int) -> tuple[Rows, int]:
    """The rows that begin at byte ``offset``, and where they end.

    order: ``<`` or ``>``. Raises InputError (``truncated_file``).
    """
    lengths = _first_lengths(source, order, element, offset)
    row_bytes = sum(int(p.type[1:]) for p in element.properties if not p.count_type)
    row_bytes += sum(
        int(p.count_type[1:]) + lengths[p.name] * int(p.type[1:])
        for p in element.properties
        if p.count_type
    )
    end = offset + element.count * row_bytes
    if not element.lists:
        require_bytes(end - offset, source.size - offset, f"{element.count:,} {element.name} rows")
    if end <= source.size and row_bytes < 1 << 31:
        rows = np.fromfile(
            source.file, _row_type(order, element, lengths), element.count, offset=offset
        )
        if all((rows["count " + name] == length).all() for name, length in lengths.items()):
            return _equal_rows(rows, element, lengths), end
    return _differing_rows(source, order, element, offset)


def _first_lengths(source: Source, order: str, element: Element, offset: int) -> dict[str, int]:
    """List name -> its length in the first row: most meshes have triangles only."""
    lengths: dict[str, int] = {}
    for p in element.properties:
        if p.count_type:
            size = int(p.count_type[1:])
            count = source.read(offset, size) if element.count else bytes(size)
            if count is None:
                raise _ends_early(element)
            lengths[p.name] = struct.unpack(order + _STRUCT[p.count_type], count)[0]
            offset += size + lengths[p.name] * int(p.type[1:])
        else:
            offset += int(p.type[1:])
    return lengths


def _row_type(order: str, element: Element, lengths: dict[str, int]) -> np.dtype:
    fields: list[tuple] = []
    for p in element.properties:
        if p.count_type:
            fields.append(("count " + p.name, order + p.count_type))
            fields.append((p.name, order + p.type, (lengths[p.name],)))
        else:
            fields.append((p.name, order + p.type))
    return np.dtype(fields)


def _equal_rows(rows: np.ndarray, element: Element, lengths: dict[str, int]) -> Rows:
    return Rows(
        {p.name: rows[p.name] for p in element.properties if not p.count_type},
        {
            name: (np.full(len(rows), length), rows[name].ravel())
            for name, length in lengths.items()
        },
    )


def _differing_rows(source: Source, order: str, element: Element, offset: int) -> tuple[Rows, int]:
    data = np.fromfile(source.file, np.uint8, offset=offset)
    starts, end = _walk(data.data, order, element)
    rows = Rows()
    for p, start in zip(element.properties, starts.T, strict=True):
        if not p.count_type:
            rows.scalars[p.name] = _gather(data, start, order + p.type)
            continue
        counts = _gather(data, start, order + p.count_type).astype(np.int64)
        size = int(p.type[1:])
        first = start + int(p.count_type[1:]) - (np.cumsum(counts) - counts) * size
        items = np.repeat(first, counts) + np.arange(counts.sum()) * size
        rows.lists[p.name] = (counts, _gather(data, items, order + p.type))
    return rows, offset + end


def _walk(data: memoryview, order: str, element: Element) -> tuple[np.ndarray, int]:
    """Where every value begins, (N, properties) int64, and where the last row ends."""
    steps = [
        (
            struct.Struct(order + _STRUCT[p.count_type]) if p.count_type else None,
            int(p.type[1:]),
        )
        for p in element.properties
    ]
    starts = array("q")
    at = 0
    try:
        for _ in range(element.count):
            for count, size in steps:
                starts.append(at)
                if count is None:
                    at += size
                else:
                    length = count.unpack_from(data, at)[0]
                    at += count.size + max(length, 0) * size
    except struct.error as error:
        raise _ends_early(element) from error
    if at > len(data):
        raise _ends_early(element)
    return np.frombuffer(starts, np.int64).reshape(-1, len(steps)), at


def _gather(data: np.ndarray, starts: np.ndarray, type_code: str) -> np.ndarray:
    size = np.dtype(type_code).itemsize
    return data[starts[:, None] + np.arange(size)].view(type_code)[:, 0]


def _ends_early(element: Element) -> InputError:
    return InputError(
        "truncated_file",
        f"The file ends within its {element.count:,} {element.name} rows; copy or export it again.",
    )
