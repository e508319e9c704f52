"""What a storage does, and how one is chosen."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from service.settings import Settings

CHUNK = 1 << 20


class StoredBytesMissing(Exception):
    """There is nothing under the key."""


class StorageFull(Exception):
    """The bytes did not fit."""


class Storage(Protocol):
    """Bytes under keys such as ``artifacts/JOB/1/mesh.glb``; a key appears whole or not at all."""

    def put(self, key: str, source: Path) -> None:
        """Store a file, which is moved away where that is cheaper than a copy.

        Raises StorageFull.
        """
        ...

    def read(self, key: str, start: int = 0, length: int | None = None) -> Iterator[bytes]:
        """The bytes in chunks. Raises StoredBytesMissing before the first chunk."""
        ...

    def fetch(self, key: str, target: Path) -> None:
        """Write the bytes to a local file. Raises StoredBytesMissing."""
        ...

    def delete(self, key: str) -> None:
        """Remove a key; one that is not there is no error."""
        ...

    def delete_all(self, prefix: str) -> None:
        """Remove every key below ``prefix``, which ends with a slash."""
        ...

    def free_bytes(self) -> int | None:
        """Room left for new bytes, or None where there is no limit to see."""
        ...

    def check(self) -> None:
        """Raises an OSError or the client's own error when the storage cannot be used."""
        ...


def open_storage(settings: Settings) -> Storage:
    """The storage that the settings name."""
    if settings.storage_url:
        from service.storage.s3 import S3Storage

        return S3Storage(settings.storage_url, settings.s3_endpoint_url or None)
    from service.storage.local import LocalStorage

    return LocalStorage(settings.data_dir / "storage", settings.storage_reserve_bytes)


def file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
