"""What a LAZ file promises about its compressed chunks.

The decoder allocates what these numbers say and, where that fails, ends the whole process; so every
one is checked against the file first. Source: the LASzip VLR and chunk table as described in
LAStools' laszip.hpp, and the layers of Isenburg, LASzip "native" compression of LAS 1.4.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from visco_core.errors import InputError
from visco_core.io.source import Source, decoding, unreadable

_RECORD_USER, _RECORD_ID = b"laszip encoded", 22204
_MOST_RECORDS = 10_000
_LAYERED = 3
_CHUNKED = (2, _LAYERED)
# Chunks have 50,000 points as a rule; the decoder allocates whole ones.
_MOST_CHUNK_BYTES = 1 << 30
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_BYTES_LAYERED = 14


@dataclass(frozen=True)
class _Packing:
    """The LASzip record; items: (kind, bytes) of the parts of a point."""

    record: bytes
    compressor: int
    items: tuple[tuple[int, int], ...]

    @property
    def layers(self) -> int:
        return sum(size if kind == _BYTES_LAYERED else _LAYERS[kind] for kind, size in self.items)


def check_chunks(source: Source, *, points: int, row_bytes: int, data_begin: int) -> None:
    """Raises InputError (``unreadable_file``) where chunks and header contradict each other."""
    packing = _find_packing(source, data_begin)
    known = all(kind in _LAYERS or kind == _BYTES_LAYERED for kind, _ in packing.items)
    if sum(size for _, size in packing.items) != row_bytes or (
        packing.compressor == _LAYERED and not known
    ):
        raise _damaged()
    at = data_begin + 8
    for count, length in _chunks(source, packing, points, data_begin):
        if count * row_bytes > _MOST_CHUNK_BYTES:
            raise _damaged()
        if packing.compressor == _LAYERED:
            _check_layers(source, packing, row_bytes, at, count, length)
        at += length


def _find_packing(source: Source, data_begin: int) -> _Packing:
    header_bytes, records = struct.unpack("<H4xI", _read(source, 94, 10))
    at = header_bytes
    for _ in range(min(records, _MOST_RECORDS)):
        user, record_id, length = struct.unpack("<2x16sHH32x", _read(source, at, 54))
        at += 54
        if at + length > data_begin:
            break
        if user.rstrip(b"\0") == _RECORD_USER and record_id == _RECORD_ID and length >= 34:
            record = _read(source, at, length)
            compressor, count = struct.unpack("<H30xH", record[:34])
            if compressor not in _CHUNKED or length < 34 + 6 * count:
                break
            items = [struct.unpack_from("<HH", record, 34 + 6 * i) for i in range(count)]
            return _Packing(record, compressor, tuple(items))
        at += length
    raise _damaged()


def _chunks(
    source: Source, packing: _Packing, points: int, data_begin: int
) -> Iterator[tuple[int, int]]:
    """Points and bytes of each chunk; together they are all points and all bytes."""
    table = struct.unpack("<q", _read(source, data_begin, 8))[0]
    if table == -1:
        table = struct.unpack("<q", _read(source, source.size - 8, 8))[0]
    count = struct.unpack("<4xI", _read(source, table, 8))[0]
    if table < data_begin + 8 or count > points:
        raise _damaged()
    lazrs: Any = import_module("lazrs")

    with decoding("LAZ"), source.file.open("rb") as file:
        file.seek(data_begin)
        chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(packing.record))
    held = sum(count for count, _ in chunks)
    if held < points or sum(length for _, length in chunks) != table - data_begin - 8:
        raise _damaged()
    yield from chunks


def _check_layers(
    source: Source, packing: _Packing, row_bytes: int, at: int, count: int, length: int
) -> None:
    """A chunk is one point as it is, a count, the size of each layer, and the layers."""
    sizes = struct.unpack(
        f"<{packing.layers + 1}I", _read(source, at + row_bytes, 4 * packing.layers + 4)
    )
    if sizes[0] > count or row_bytes + 4 * len(sizes) + sum(sizes[1:]) > length:
        raise _damaged()


def _read(source: Source, offset: int, length: int) -> bytes:
    data = source.read(offset, length)
    if data is None:
        raise _damaged()
    return data


def _damaged() -> InputError:
    return unreadable("The compressed points of the LAZ file contradict its header")
