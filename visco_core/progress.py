"""How a running reconstruction reports, and how it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

Phase = Literal[
    "read", "prepare", "normals", "noise", "start", "refine", "solve", "extract", "write"
]


@dataclass(frozen=True)
class Progress:
    """One moment of a reconstruction.

    ``fraction`` grows from 0 to 1 over the whole run. ``level`` counts from 1 to ``levels`` and
    ``step`` from 1 to ``steps`` within the level; both are 0 outside the solve. ``losses`` holds
    the weighted terms ``point``, ``normal``, ``viscosity`` and ``coarea`` after the step.
    ``remaining_seconds`` is None until one level has been timed.
    """

    phase: Phase
    fraction: float
    elapsed_seconds: float
    remaining_seconds: float | None = None
    level: int = 0
    levels: int = 0
    resolution: int = 0
    step: int = 0
    steps: int = 0
    losses: Mapping[str, float] = field(default_factory=dict)


ProgressCallback = Callable[[Progress], None]
ShouldStop = Callable[[], bool]
