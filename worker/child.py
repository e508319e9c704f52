"""Imported by Celery in parent and child: what it is told when processes begin and end."""

from __future__ import annotations

import os

from celery import signals


@signals.setup_logging.connect
def keep_logging(**_: object) -> None:
    """A receiver is all it takes to leave the logging as it has been set up."""


@signals.worker_process_init.connect
def child_started(**_: object) -> None:
    from worker.context import open_child

    open_child()


@signals.worker_process_shutdown.connect
def child_ending(exitcode: int, **_: object) -> None:
    """Leave at once: the pool would sleep for a second here, and Ctrl-C should not take long."""
    os._exit(exitcode)
