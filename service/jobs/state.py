"""The life of a job as one table."""

from __future__ import annotations

from typing import Literal, get_args

Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]
Terminal = Literal["succeeded", "failed", "cancelled"]
TERMINAL: frozenset[Status] = frozenset(get_args(Terminal))

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

# What an event may be of; those of a job's status say that it has turned into it.
EventType = Literal[
    "queued",
    "started",
    "progress",
    "scan",
    "level",
    "artifact",
    "degraded",
    "requeued",
    "cancel_requested",
    "succeeded",
    "failed",
    "cancelled",
]

AttemptOutcome = Literal["succeeded", "failed", "cancelled", "lost", "released"]


class IllegalTransition(RuntimeError):
    """The code asked for a status change that the table does not have."""


def check_transition(current: Status, target: Status) -> None:
    """Raises IllegalTransition unless the table has the step."""
    if target not in TRANSITIONS[current]:
        raise IllegalTransition(f"a {current} job cannot become {target}")
