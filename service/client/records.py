"""What the client gives back: plain records, with the whole answer in ``raw``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

TERMINAL = frozenset({"succeeded", "failed", "cancelled"})


@dataclass(frozen=True)
class Artifact:
    """A file that a job has left."""

    name: str
    size: int
    sha256: str
    content_type: str

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Artifact:
        return cls(raw["name"], raw["size"], raw["sha256"], raw["content_type"])


@dataclass(frozen=True)
class Job:
    """A job as the service last told of it; ``fraction`` goes from 0 to 1."""

    id: str
    status: str
    label: str | None
    fraction: float
    error_code: str | None
    error_detail: str | None
    artifacts: Mapping[str, Artifact]
    raw: Mapping[str, Any] = field(repr=False)

    @property
    def is_finished(self) -> bool:
        return self.status in TERMINAL

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Job:
        progress, error = raw["progress"] or {}, raw["error"] or {}
        artifacts = {item["name"]: Artifact.of(item) for item in raw["artifacts"]}
        fraction = 1.0 if raw["status"] == "succeeded" else progress.get("fraction", 0.0)
        return cls(
            id=raw["id"],
            status=raw["status"],
            label=raw["label"],
            fraction=fraction,
            error_code=error.get("code"),
            error_detail=error.get("detail"),
            artifacts=artifacts,
            raw=raw,
        )


@dataclass(frozen=True)
class Event:
    """One event of a job; ``sequence`` goes on where a broken stream ended."""

    sequence: int
    type: str
    data: Mapping[str, Any]

    @property
    def is_last(self) -> bool:
        return self.type in TERMINAL
