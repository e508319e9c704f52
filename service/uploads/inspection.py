"""Refusing what is no scan before it costs anything: only headers are read here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from service.errors import ServiceError
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


def inspect_head(head: bytes, size: int, name: str, max_points: int) -> Inspection:
    """The same for the first bytes of a file that will have at most ``size`` of them."""
    return _inspect(head, size, name, max_points)


def _inspect(source: Path | bytes, size: int | None, name: str, max_points: int) -> Inspection:
    from visco_core.io import sniff_points

    try:
        header = sniff_points(source, size, name=name, max_points=max_points)
    except InputError as error:
        code = _TOO_MANY if error.code == _TOO_MANY else "not_a_point_cloud"
        return Inspection(None, ServiceError(code, error.detail))
    return Inspection(header.points)
