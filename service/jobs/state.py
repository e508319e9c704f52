"""The life of a job as one table."""

from __future__ import annotations

from typing import Literal

Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]
TERMINAL: frozenset[Status] = frozenset({"succeeded", "failed", "cancelled"})

# From each state to the states it may turn into, with what makes it so.
TRANSITIONS: dict[Status, dict[Status, str]] = {
    "queued": {
        "running": "a worker claims it",
        "cancelled": "its owner cancels it before it starts",
        "failed": "too many workers were lost with it",
    },
    "running": {
        "queued": "its worker is lost or gives it back",
        "succeeded": "the mesh is stored",
        "failed": "the scan, the solve or the storage fails",
        "cancelled": "its owner cancels it",
    },
    "succeeded": {},
    "failed": {},
    "cancelled": {},
}

AttemptOutcome = Literal["succeeded", "failed", "cancelled", "lost", "released"]


class IllegalTransition(RuntimeError):
    """The code asked for a status change that the table does not have."""


def check_transition(current: Status, target: Status) -> None:
    """Raises IllegalTransition unless the table has the step."""
    if target not in TRANSITIONS[current]:
        raise IllegalTransition(f"a {current} job cannot become {target}")
