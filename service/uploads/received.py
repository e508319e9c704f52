"""Bytes on their way in: counted, hashed and written to a temporary file."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import re
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from service.errors import ServiceError
from visco_core.io import HEAD_BYTES

_UNWANTED = re.compile(r"[\x00-\x1f\x7f/\\]+")


@dataclass(frozen=True)
class ReceivedFile:
    """A file that has arrived whole but belongs to nobody yet."""

    path: Path
    name: str
    size: int
    sha256: str

    def discard(self) -> None:
        self.path.unlink(missing_ok=True)


class Receiver:
    """Writes chunks to a temporary file. Use as a context manager: what is not kept is removed.

    ``judge`` is shown the first bytes of a file that has more of them, and raises ServiceError for
    one that need not be received to its end.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        most_bytes: int,
        judge: Callable[[bytes], None] | None = None,
    ) -> None:
        self.name = name
        self.most_bytes = most_bytes
        self._judge = judge
        self._head = bytearray()
        self.size = 0
        self.hashes = {"sha256": hashlib.sha256(), "sha1": hashlib.sha1(usedforsecurity=False)}
        # Some formats are known by the ending of the name alone.
        self.path = folder / f"{uuid.uuid4().hex}{Path(name).suffix[:16].lower()}"
        self._file = self.path.open("xb")
        self._kept = False

    def write(self, chunk: bytes) -> None:
        """Raises ServiceError (``too_large``, ``storage_full``, and what the judge says)."""
        self.size += len(chunk)
        if self.size > self.most_bytes:
            raise too_large(self.most_bytes)
        self._show(chunk)
        for digest in self.hashes.values():
            digest.update(chunk)
        try:
            self._file.write(chunk)
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                raise storage_full() from error
            raise

    def _show(self, chunk: bytes) -> None:
        if self._judge is None:
            return
        self._head += chunk[: HEAD_BYTES - len(self._head)]
        if self.size > HEAD_BYTES:
            self._judge(bytes(self._head))
            self._judge = None
            self._head.clear()

    def keep(self) -> ReceivedFile:
        """The finished file, which is now the caller's to store or discard."""
        self._file.close()
        self._kept = True
        return ReceivedFile(self.path, self.name, self.size, self.hashes["sha256"].hexdigest())

    def __enter__(self) -> Receiver:
        return self

    def __exit__(self, *exception: object) -> None:
        with contextlib.suppress(OSError):
            self._file.close()
        if not self._kept:
            self.path.unlink(missing_ok=True)


def too_large(most_bytes: int) -> ServiceError:
    return ServiceError(
        "too_large", f"Send at most {most_bytes:,} bytes; thin the scan out or crop it."
    )


def storage_full() -> ServiceError:
    return ServiceError(
        "storage_full", "Delete finished jobs or ask the operator for more room, then try again."
    )


def clean_name(name: str) -> str:
    """A file name without folders and control characters, at most 255 characters long."""
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    cleaned = _UNWANTED.sub("", last).strip().lstrip(".")
    return cleaned[-255:] or "scan"
