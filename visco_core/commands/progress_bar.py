"""The progress bar of a terminal: phase, level, step, time left."""

from __future__ import annotations

from typing import Any

from visco_core.progress import Progress

_WORDS = {
    "read": "reading",
    "prepare": "cleaning",
    "normals": "estimating normals",
    "noise": "measuring the noise",
    "start": "finding inside and outside",
    "refine": "refining",
    "solve": "solving",
    "extract": "extracting",
    "write": "writing",
}


class ProgressBar:
    """Shows Progress records on standard error while it is entered; silent unless enabled."""

    def __init__(self, enabled: bool) -> None:
        self._bar: Any = None
        self._enabled = enabled

    def __enter__(self) -> ProgressBar:
        if self._enabled:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            columns = (BarColumn(), TextColumn("{task.percentage:3.0f}% {task.description}"))
            self._bar = Bar(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._task = self._bar.add_task("starting", total=1.0)
        return self

    def show(self, progress: Progress) -> None:
        if self._bar is not None:
            self._bar.update(
                self._task, completed=progress.fraction, description=describe(progress)
            )

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()


def describe(progress: Progress) -> str:
    """One line such as ``solving level 2/3 (128³), step 4/6, 3 s left``."""
    words = [_WORDS[progress.phase]]
    if progress.level:
        words.append(
            f"level {progress.level}/{progress.levels} ({progress.resolution}³), "
            f"step {progress.step}/{progress.steps}"
        )
    line = " ".join(words)
    if progress.remaining_seconds is not None:
        line += f", {progress.remaining_seconds:.0f} s left"
    return line
