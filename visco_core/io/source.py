"""What a reader is given, what a header says, and the checks all formats share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from visco_core.errors import InputError, VisCoError

HEAD_BYTES = 1 << 18
"""A header that has not ended after this many bytes is refused."""


@dataclass(frozen=True)
class PointHeader:
    """What a file says about itself, before any of its points is read.

    ``points`` is None where the format has no count (OBJ, XYZ) or where the count lies outside the
    bytes that were given. ``encoding`` is the format's own word, such as ``binary_little_endian``.
    """

    format: str
    encoding: str
    points: int | None
    has_normals: bool = False
    has_colors: bool = False


@dataclass(frozen=True)
class Source:
    """A file, or only its beginning and its length.

    ``head`` holds the first bytes, up to ``HEAD_BYTES``; ``path`` is None where there is no file
    yet, as in an upload. The length may be smaller than ``size`` where that is not ``exact``.
    """

    head: bytes
    size: int
    name: str = ""
    path: Path | None = None
    exact: bool = True

    @classmethod
    def of_file(cls, path: str | Path) -> Source:
        """The file at ``path``. Raises InputError (``unreadable_file``)."""
        path = Path(path)
        try:
            with path.open("rb") as file:
                return cls(file.read(HEAD_BYTES), path.stat().st_size, path.name, path)
        except OSError as error:
            reason = error.strerror or "unknown reason"
            raise InputError(
                "unreadable_file", f"{path} cannot be opened ({reason}); check the path."
            ) from error

    @property
    def suffix(self) -> str:
        return Path(self.name).suffix.lower()

    @property
    def file(self) -> Path:
        """The file itself; only readers ask, and they always have one."""
        if self.path is None:
            raise TypeError("points can only be read from a file")
        return self.path

    def read(self, offset: int, length: int) -> bytes | None:
        """``length`` bytes from ``offset``; None where they lie outside of what was given."""
        if offset < 0 or length < 0 or offset + length > self.size:
            return None
        if offset + length <= len(self.head):
            return self.head[offset : offset + length]
        if self.path is None:
            return None
        with self.path.open("rb") as file:
            file.seek(offset)
            return file.read(length)

    def read_all(self) -> bytes:
        return self.head if len(self.head) == self.size else self.file.read_bytes()


def require_bytes(promised: int, available: int, what: str) -> None:
    """Raises InputError (``truncated_file``) where ``what`` needs more bytes than there are."""
    if promised > available:
        raise InputError(
            "truncated_file",
            f"The file ends too early: its header promises {what}, which need {promised:,} bytes, "
            f"but only {available:,} follow; copy or export it again.",
        )


def require_points(points: int | None, max_points: int | None) -> None:
    """Raises InputError where there are none (``no_points``) or too many (``too_many_points``)."""
    if points == 0:
        raise no_points()
    if points is not None and max_points is not None and points > max_points:
        raise InputError(
            "too_many_points",
            f"The file holds {points:,} points and the limit is {max_points:,}; thin the scan out.",
        )


def no_points() -> InputError:
    return InputError("no_points", "The file holds no points; export the scan again.")


def unreadable(problem: str) -> InputError:
    """The error for a file of a known format with broken content."""
    return InputError("unreadable_file", f"{problem}; export the file again.")


@contextmanager
def decoding(format_name: str) -> Iterator[None]:
    """Turns whatever a third-party decoder raises at broken bytes into InputError.

    Decoders answer hostile bytes with anything from struct.error to IndexError, and those written
    in Rust with a panic that is no ``Exception``; so this one place catches them all.
    """
    try:
        yield
    except (VisCoError, MemoryError):
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise unreadable(f"The {format_name} data are damaged ({reason})") from error
