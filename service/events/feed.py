"""The events of a job as a stream, without a gap and without a repetition.

The database is read by sequence number, so that it does not matter which process stored an event.
A message of the broker only says that looking is worth while; without it the feed looks by itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import defaultdict
from collections.abc import AsyncIterator

from starlette.concurrency import run_in_threadpool

from service.db import Database
from service.jobs.model import Event, Job
from service.jobs.queries import events_after
from service.jobs.queues import events_channel
from service.settings import Settings

log = logging.getLogger(__name__)
_POLL_SECONDS = 1.0
_RECONNECT_SECONDS = 2.0


class EventFeed:
    """One subscription a process, shared by everyone who follows a job."""

    def __init__(self, database: Database, settings: Settings) -> None:
        self.database = database
        self.settings = settings
        self._watchers: defaultdict[str, set[asyncio.Event]] = defaultdict(set)
        self._task: asyncio.Task[None] | None = None
        self._closing = False

    def start(self) -> None:
        self._task = asyncio.create_task(self._listen())

    async def close(self) -> None:
        """End the subscription and every stream."""
        self.end_streams()
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    def end_streams(self) -> None:
        self._closing = True
        for watchers in self._watchers.values():
            for wake in watchers:
                wake.set()

    async def follow(self, job_id: str, after: int) -> AsyncIterator[Event | None]:
        """Events with a sequence above ``after``, to the job's last one; None while it is quiet."""
        wake = asyncio.Event()
        self._watchers[job_id].add(wake)
        try:
            while not self._closing:
                wake.clear()
                events, finished = await run_in_threadpool(self._read, job_id, after)
                for event in events:
                    yield event
                    after = event.sequence
                if finished:
                    return
                if events:
                    continue
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(wake.wait(), _POLL_SECONDS)
                yield None
        finally:
            self._watchers[job_id].discard(wake)
            if not self._watchers[job_id]:
                del self._watchers[job_id]

    def _read(self, job_id: str, after: int) -> tuple[list[Event], bool]:
        with self.database.read() as session:
            job = session.get(Job, job_id)
            if job is None:
                return [], True
            events = events_after(session, job_id, after)
            last = events[-1].sequence if events else after
            return events, job.is_terminal and last >= job.last_sequence

    async def _listen(self) -> None:
        while True:
            try:
                await self._receive()
            except Exception as error:  # noqa: BLE001  streams go on by polling
                log.debug("The broker's event channel is away: %s", error)
            await asyncio.sleep(_RECONNECT_SECONDS)

    async def _receive(self) -> None:
        from redis.asyncio import Redis

        client = Redis.from_url(self.settings.redis_address)
        prefix = events_channel("")
        try:
            async with client.pubsub(ignore_subscribe_messages=True) as channel:
                await channel.psubscribe(events_channel("*"))
                async for message in channel.listen():
                    job_id = message["channel"].decode().removeprefix(prefix)
                    for wake in self._watchers.get(job_id, ()):
                        wake.set()
        finally:
            await client.aclose()
