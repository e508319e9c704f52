"""What a folder watch has done so far: a small file that survives a crash at any moment."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

State = Literal["submitting", "submitted", "done", "failed"]


@dataclass(frozen=True)
class Entry:
    """One scan: a file with this size, time of change and hash.

    ``key`` is its Idempotency-Key, written down before the first try to submit it, so that a
    second try after a crash gives the same job.
    """

    size: int
    changed_ns: int
    sha256: str
    key: str
    prefix: str
    state: State = "submitting"
    job_id: str | None = None
    begun_at: float = 0.0

    def evolve(self, **changes: Any) -> Entry:
        return replace(self, **changes)


class Ledger:
    """Entries by file name; every change is on the disk before the next step is made."""

    def __init__(self, path: Path) -> None:
        self._file = sqlite3.connect(path, isolation_level=None)
        self._file.execute("PRAGMA synchronous = FULL")
        self._file.execute(
            "CREATE TABLE IF NOT EXISTS scans (name TEXT PRIMARY KEY, entry TEXT NOT NULL)"
        )
        rows = self._file.execute("SELECT name, entry FROM scans")
        self.entries = {name: Entry(**json.loads(entry)) for name, entry in rows}

    def put(self, name: str, entry: Entry) -> None:
        self.entries[name] = entry
        row = (name, json.dumps(asdict(entry)))
        self._file.execute("INSERT OR REPLACE INTO scans VALUES (?, ?)", row)

    def forget(self, names: set[str]) -> None:
        for name in names:
            del self.entries[name]
            self._file.execute("DELETE FROM scans WHERE name = ?", (name,))

    def close(self) -> None:
        self._file.close()
