"""The one place that knows the time: stop requests, budget, progress, the report's phases."""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visco_core.errors import Stopped
from visco_core.progress import Phase, Progress, ProgressCallback, ShouldStop

LAST_FRACTION = 0.99
"""No progress says that all is done while something is still being done."""


@dataclass
class Clock:
    """Watches one reconstruction.

    Times are ``time.monotonic()`` seconds. ``phases`` and ``steps`` grow into the report.
    """

    started_at: float
    budget_seconds: float | None = None
    should_stop: ShouldStop | None = None
    on_progress: ProgressCallback | None = None
    phases: list[dict[str, Any]] = field(default_factory=list)
    steps: list[dict[str, Any]] = field(default_factory=list)
    _slice_ends_at: float = float("inf")
    _expected_seconds: float | None = None
    _fraction: float = 0.0

    @property
    def elapsed_seconds(self) -> float:
        return time.monotonic() - self.started_at

    @property
    def remaining_seconds(self) -> float:
        """What is left of the budget; infinite where there is none."""
        if self.budget_seconds is None:
            return float("inf")
        return self.budget_seconds - self.elapsed_seconds

    def check(self) -> None:
        """Raises Stopped when the caller asked to stop."""
        if self.should_stop is not None and self.should_stop():
            raise Stopped

    def start_slice(self, seconds: float) -> None:
        """Gives the work that begins now this long before ``late`` turns true."""
        self._slice_ends_at = time.monotonic() + seconds

    def late(self) -> bool:
        """Whether the current slice of the budget is used up."""
        return time.monotonic() > self._slice_ends_at

    @property
    def slice_seconds(self) -> float:
        """What is left of the current slice."""
        return max(self._slice_ends_at - time.monotonic(), 0.0)

    def expect(self, more_seconds: float) -> None:
        """Says how long the rest will take, as far as is known now."""
        self._expected_seconds = self.elapsed_seconds + more_seconds

    @contextmanager
    def phase(self, name: Phase, **details: Any) -> Iterator[dict[str, Any]]:
        """Times a phase for the report; yields its entry so that results can be added to it."""
        self.check()
        self.report(name)
        entry: dict[str, Any] = {"phase": name, **details}
        begun = time.monotonic()
        yield entry
        entry["seconds"] = round(time.monotonic() - begun, 4)
        entry["peak_memory_bytes"] = peak_memory_bytes()
        self.phases.append(entry)
        self.check()

    def report(self, phase: Phase, **details: Any) -> None:
        """Sends a Progress whose fraction never falls."""
        if self.on_progress is None:
            return
        elapsed = self.elapsed_seconds
        remaining = None
        if self._expected_seconds is not None:
            remaining = max(self._expected_seconds - elapsed, 0.0)
            done = min(elapsed / max(elapsed + remaining, 1e-9), LAST_FRACTION)
            self._fraction = max(self._fraction, done)
        self.on_progress(Progress(phase, self._fraction, elapsed, remaining, **details))


def peak_memory_bytes() -> int:
    """The most memory that this process has held so far.

    Linux keeps two such marks. ``ru_maxrss`` outlives ``exec``, so a child of a large program would
    show its parent's peak; ``VmHWM`` is this program's own.
    """
    if sys.platform == "linux":
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.split("VmHWM:", 1)[1].split(maxsplit=1)[0]) * 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
