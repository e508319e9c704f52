"""Refusing what is no scan before it costs anything: only headers are read here."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from service.errors import ServiceError
from service.settings import Settings
from service.uploads.received import too_large
from visco_core.errors import InputError

_TOO_MANY = "too_many_points"


@dataclass(frozen=True)
class Inspection:
    """What a header says; ``points`` is None where the format does not count them."""

    points: int | None
    refusal: ServiceError | None = None


def inspect_file(path: Path, max_points: int) -> Inspection:
    """Check the magic bytes, the header against the file's length, and the count of points."""
    return _inspect(path, None, path.name, max_points)


@dataclass(frozen=True)
class Length:
    """What is known of a file's length before it has arrived; nothing, if ``size`` is None."""

    size: int | None = None
    exact: bool = False


def check_head(head: bytes, length: Length, name: str, settings: Settings) -> None:
    """Refuse a file by its first bytes. Raises ServiceError (``not_a_point_cloud``, …)."""
    most = settings.max_upload_bytes
    size = most if length.size is None else length.size
    refusal = _inspect(head, size, name, settings.max_points, length.exact).refusal
    if refusal is None:
        return
    if length.size is None and not _inspect(head, sys.maxsize, name, settings.max_points).refusal:
        # The header promises more than is ever taken; the file may well keep its promise.
        raise too_large(most)
    raise refusal


def _inspect(
    source: Path | bytes, size: int | None, name: str, max_points: int, exact: bool = False
) -> Inspection:
    from visco_core.io import sniff_points

    try:
        header = sniff_points(source, size, exact=exact, name=name, max_points=max_points)
    except InputError as error:
        code = _TOO_MANY if error.code == _TOO_MANY else "not_a_point_cloud"
        return Inspection(None, ServiceError(code, error.detail))
    return Inspection(header.points)
