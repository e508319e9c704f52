"""What an API process does beside answering: reap, sweep, and deliver webhooks."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable

from starlette.concurrency import run_in_threadpool

from service.api.container import Services
from service.jobs.reaper import Reaper
from service.jobs.sweeper import Sweeper
from service.webhooks.sender import WebhookSender

log = logging.getLogger(__name__)
_WEBHOOK_SECONDS = 1.0
_SWEEP_SECONDS = 600.0


class Housekeeper:
    """Runs each chore in turns of its own; a chore that fails is tried again on its next turn."""

    def __init__(self, parts: Services) -> None:
        self.sender = WebhookSender(parts.database, parts.settings)
        reaper = Reaper(parts.database, parts.bell, parts.settings)
        sweeper = Sweeper(parts.database, parts.storage, parts.settings)
        self._chores: list[tuple[Callable[[], object], float]] = [
            (reaper.run, parts.settings.reap_seconds),
            (sweeper.run, _SWEEP_SECONDS),
            (self.sender.send_due, _WEBHOOK_SECONDS),
        ]
        self._tasks: list[asyncio.Task[None]] = []
        self._closing = asyncio.Event()

    def start(self) -> None:
        self._tasks = [asyncio.create_task(self._repeat(*chore)) for chore in self._chores]

    async def close(self) -> None:
        """Wait for the chores under way: a task can be cancelled, what its thread does cannot."""
        self._closing.set()
        self.sender.stop()
        await asyncio.gather(*self._tasks)
        self.sender.close()

    async def _repeat(self, chore: Callable[[], object], seconds: float) -> None:
        while not self._closing.is_set():
            try:
                await run_in_threadpool(chore)
            except Exception:
                log.exception("A chore failed; it is tried again in %s s", seconds)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._closing.wait(), seconds)
