"""Bytes in a folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.storage import StoredBytesMissing
from service.storage.local import LocalStorage


@pytest.fixture
def storage(tmp_path: Path) -> LocalStorage:
    return LocalStorage(tmp_path / "storage")


def put(storage: LocalStorage, folder: Path, key: str, data: bytes) -> None:
    source = folder / "source"
    source.write_bytes(data)
    storage.put(key, source)


def test_what_was_put_is_read_whole_or_in_part(storage: LocalStorage, tmp_path: Path) -> None:
    put(storage, tmp_path, "a/b.bin", b"0123456789")
    assert b"".join(storage.read("a/b.bin")) == b"0123456789"
    assert b"".join(storage.read("a/b.bin", 3, 4)) == b"3456"
    storage.fetch("a/b.bin", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == b"0123456789"


def test_putting_again_replaces_and_leaves_no_temporary_file(
    storage: LocalStorage, tmp_path: Path
) -> None:
    put(storage, tmp_path, "a/b.bin", b"old")
    put(storage, tmp_path, "a/b.bin", b"new")
    assert [path.name for path in (storage.root / "a").iterdir()] == ["b.bin"]
    assert b"".join(storage.read("a/b.bin")) == b"new"


def test_what_is_not_there_is_missing(storage: LocalStorage, tmp_path: Path) -> None:
    with pytest.raises(StoredBytesMissing):
        storage.read("nothing")
    with pytest.raises(StoredBytesMissing):
        storage.fetch("nothing", tmp_path / "copy")
    storage.delete("nothing")
    storage.delete_all("nothing/")


def test_delete_all_takes_everything_below_the_prefix(
    storage: LocalStorage, tmp_path: Path
) -> None:
    for key in ("a/1/x", "a/2/y", "b/1/z"):
        put(storage, tmp_path, key, b"x")
    storage.delete_all("a/")
    assert [p.name for p in storage.root.rglob("*") if p.is_file()] == ["z"]


def test_a_key_cannot_leave_the_folder(storage: LocalStorage, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="leaves the storage"):
        put(storage, tmp_path, "../outside", b"x")
