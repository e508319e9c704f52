"""Rows of numbers in text: fast, and never a row more or fewer than the text has."""

from __future__ import annotations

import io
import re

import numpy as np

from visco_core.errors import InputError
from visco_core.io.source import unreadable


def split_lines(text: bytes) -> tuple[bytes, np.ndarray]:
    """``text`` with every line ended by a newline, and (L + 1,) offsets at which lines begin.

    Lines without content are dropped; line k is ``text[offsets[k] : offsets[k + 1]]``.
    """
    if b"\r" in text and b"\n" not in text:
        text = text.replace(b"\r", b"\n")
    if text and not text.endswith(b"\n"):
        text += b"\n"
    if re.search(rb"(?:\A|\n)[ \t\r]*\n", text):
        text = b"".join(line + b"\n" for line in text.split(b"\n") if line.strip())
    ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n")) + 1
    return text, np.concatenate([[0], ends])


def parse_table(text: bytes, rows: int, columns: int | None = None) -> np.ndarray:
    """(rows, columns) float64 of numbers between blanks, as ``split_lines`` leaves them.

    Raises InputError: ``truncated_file`` where only the last row is broken, else
    ``unreadable_file`` with the number of the row.
    """
    if not rows:
        return np.empty((0, columns or 0))
    if not text.strip():
        raise unreadable("The rows have no numbers")
    try:
        table = np.loadtxt(io.BytesIO(text), comments=None, ndmin=2, encoding="latin-1")
    except ValueError as error:
        raise _broken_row(str(error), rows) from error
    if len(table) != rows:
        raise unreadable(f"There are {len(table):,} rows of numbers where {rows:,} were counted")
    if columns is not None and table.shape[1] != columns:
        raise unreadable(f"The rows have {table.shape[1]} numbers where the header names {columns}")
    return table


def whole_numbers(values: np.ndarray) -> np.ndarray:
    """int64 of floats; zero for what is no number, the nearest of 32 bits for what is too large."""
    return np.clip(np.nan_to_num(values), -(2.0**31), 2.0**32).astype(np.int64)


def _broken_row(message: str, rows: int) -> InputError:
    found = re.search(r"at row (\d+)", message)
    row = int(found.group(1)) if found else 0
    # numpy counts from 0 where a word is no number, and from 1 where the columns differ.
    row += "convert" in message
    if row >= rows > 1:
        return InputError(
            "truncated_file", "The last row of numbers is cut off; copy or export the file again."
        )
    return unreadable(f"Row {row:,} of the numbers cannot be read like the others")
