"""The client for asyncio programs; see ``Client`` for what the calls do."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import httpx

from service.client import calls
from service.client.calls import JobCallback, UploadCallback
from service.client.flow import Flow, Pause, Reply, Save
from service.client.options import STREAM_TIMEOUT, client_options
from service.client.records import Event, Job
from service.client.sse import EventStream

T = TypeVar("T")


class AsyncClient:
    """``Client`` with ``await``; use it as an asynchronous context manager."""

    def __init__(self, url: str | None = None, key: str | None = None) -> None:
        self._http = httpx.AsyncClient(**client_options(url, key))

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *exception: object) -> None:
        await self.close()

    async def close(self) -> None:
        await self._http.aclose()

    async def submit(
        self,
        scan: str | Path,
        *,
        idempotency_key: str | None = None,
        on_upload: UploadCallback | None = None,
        **params: Any,
    ) -> Job:
        return await self._run(calls.submit(Path(scan), params, idempotency_key, on_upload))

    async def upload(self, scan: str | Path, on_upload: UploadCallback | None = None) -> str:
        return await self._run(calls.upload(Path(scan), on_upload))

    async def get(self, job_id: str) -> Job:
        return await self._run(calls.get(job_id))

    async def jobs(self, **query: Any) -> AsyncIterator[Job]:
        cursor: str | None = None
        while True:
            jobs, cursor = await self._run(calls.page({**query, "cursor": cursor}))
            for job in jobs:
                yield job
            if cursor is None:
                return

    async def wait(
        self, job_id: str, on_progress: JobCallback | None = None, timeout: float | None = None
    ) -> Job:
        return await self._run(calls.wait(job_id, on_progress, timeout))

    async def cancel(self, job_id: str) -> Job:
        return await self._run(calls.cancel(job_id))

    async def retry(self, job_id: str, **changes: Any) -> Job:
        return await self._run(calls.retry(job_id, changes))

    async def delete(self, job_id: str) -> None:
        return await self._run(calls.delete(job_id))

    async def download(self, job_id: str, name: str, target: str | Path) -> Path:
        return await self._run(calls.download(job_id, name, Path(target)))

    async def options(self) -> Mapping[str, Any]:
        return await self._run(calls.fetch_json("/v1/options"))

    async def info(self) -> Mapping[str, Any]:
        return await self._run(calls.fetch_json("/v1/info"))

    async def events(self, job_id: str, after: int = 0) -> AsyncIterator[Event]:
        stream = EventStream(job_id, after)
        while not stream.ended:
            reply: httpx.Response | httpx.TransportError
            try:
                async with self._http.stream(
                    "GET", stream.path, headers=stream.headers, timeout=STREAM_TIMEOUT
                ) as reply:
                    if not reply.is_success:
                        await reply.aread()
                    async for line in reply.aiter_lines():
                        event = stream.feed(line)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                reply = error
            await asyncio.sleep(stream.pause_after(reply))

    async def _run(self, flow: Flow[T]) -> T:
        reply: Reply = None
        while True:
            try:
                action = flow.send(reply)
            except StopIteration as end:
                return end.value
            if isinstance(action, Pause):
                await asyncio.sleep(action.seconds)
                reply = None
                continue
            try:
                if isinstance(action, Save):
                    reply = await self._save(action)
                else:
                    reply = await self._http.request(
                        action.method, action.path, headers=action.headers, **action.options
                    )
            except httpx.TransportError as error:
                reply = error

    async def _save(self, action: Save) -> httpx.Response:
        async with self._http.stream("GET", action.path, headers=action.headers) as reply:
            if not reply.is_success:
                await reply.aread()
                return reply
            with action.target.open("ab" if reply.status_code == 206 else "wb") as file:
                async for chunk in reply.aiter_bytes():
                    file.write(chunk)
        return reply
