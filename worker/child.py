"""Imported by Celery in parent and child; only a child hears these signals."""

from __future__ import annotations

import os

from celery import signals


@signals.worker_process_init.connect
def child_started(**_: object) -> None:
    from worker.context import open_child

    open_child()


@signals.worker_process_shutdown.connect
def child_ending(exitcode: int, **_: object) -> None:
    """Leave at once: the pool would sleep for a second here, and Ctrl-C should not take long."""
    os._exit(exitcode)
