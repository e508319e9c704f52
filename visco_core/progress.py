"""How a running reconstruction reports, and how it is stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Literal, TypeVar

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

Check = Callable[[], None]
"""Raises Stopped when the caller wants to stop; long work calls it between its pieces."""

ASKED_EVERY = 0.1
"""Seconds between two checks while a call that cannot be cut into pieces runs."""

T = TypeVar("T")


def never() -> None:
    """The check of whoever cannot be stopped."""


def attend(work: Callable[[], T], check: Check) -> T:
    """``work()`` in a thread of its own, so that a stop request need not wait for it.

    For single calls into native code that run for seconds without holding the interpreter. After a
    stop such a call still runs to its end, unheeded.
    """
    pool = ThreadPoolExecutor(1)
    try:
        future = pool.submit(work)
        while not wait([future], ASKED_EVERY).done:
            check()
        return future.result()
    finally:
        pool.shutdown(wait=False)
