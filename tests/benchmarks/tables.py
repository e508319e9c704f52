"""Tables that read well on a terminal and in a document."""

from __future__ import annotations

from collections.abc import Sequence

Cell = str | float | None


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[Cell]]) -> str:
    """A Markdown table with aligned columns; numbers to the right, None as a dash."""
    texts = [[_text(cell) for cell in row] for row in rows]
    numeric = [
        all(not isinstance(row[column], str) for row in rows) for column in range(len(header))
    ]
    widths = [max(map(len, column)) for column in zip(header, *texts, strict=True)]
    lines = [
        _line(header, widths, numeric),
        "|".join(
            ["", *(_rule(width, right) for width, right in zip(widths, numeric, strict=True)), ""]
        ),
        *(_line(row, widths, numeric) for row in texts),
    ]
    return "\n".join(lines)


def mark_best(values: Sequence[float | None], digits: int) -> list[str]:
    """The values as texts, the smallest in bold, None as a dash."""
    known = [round(value, digits) for value in values if value is not None]
    texts = []
    for value in values:
        if value is None:
            texts.append("-")
        elif round(value, digits) == min(known):
            texts.append(f"**{value:.{digits}f}**")
        else:
            texts.append(f"{value:.{digits}f}")
    return texts


def rounded(value: float | None, digits: int) -> str:
    """``value`` with so many digits after the point, None as a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def _text(cell: Cell) -> str:
    if cell is None:
        return "-"
    return cell if isinstance(cell, str) else f"{cell:.4g}"


def _line(cells: Sequence[str], widths: Sequence[int], right: Sequence[bool]) -> str:
    padded = [
        cell.rjust(width) if aligned else cell.ljust(width)
        for cell, width, aligned in zip(cells, widths, right, strict=True)
    ]
    return f"| {' | '.join(padded)} |"


def _rule(width: int, right: bool) -> str:
    return "-" * (width + 1) + (":" if right else "-")
