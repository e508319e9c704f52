"""The client for ordinary programs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
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


class Client:
    """Calls the service at ``url`` with an API ``key``; use it as a context manager.

    Calls are tried again with growing pauses while the service cannot be reached. They raise
    ApiError for what the service refuses, and ServiceUnreachable.
    """

    def __init__(self, url: str | None = None, key: str | None = None) -> None:
        self._http = httpx.Client(**client_options(url, key))

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def submit(
        self,
        scan: str | Path,
        *,
        idempotency_key: str | None = None,
        on_upload: UploadCallback | None = None,
        **params: Any,
    ) -> Job:
        """Send a scan; ``params`` are those of ``options()``. Large scans survive a cut."""
        return self._run(calls.submit(Path(scan), params, idempotency_key, on_upload))

    def upload(self, scan: str | Path, on_upload: UploadCallback | None = None) -> str:
        """Send a scan in pieces; gives the upload's id."""
        return self._run(calls.upload(Path(scan), on_upload))

    def get(self, job_id: str) -> Job:
        return self._run(calls.get(job_id))

    def jobs(self, **query: Any) -> Iterator[Job]:
        """All jobs, newest first; ``status``, ``label`` and ``q`` filter."""
        cursor: str | None = None
        while True:
            jobs, cursor = self._run(calls.page({**query, "cursor": cursor}))
            yield from jobs
            if cursor is None:
                return

    def wait(
        self, job_id: str, on_progress: JobCallback | None = None, timeout: float | None = None
    ) -> Job:
        """The job once it has succeeded. Raises JobUnsuccessful or WaitTimeout."""
        return self._run(calls.wait(job_id, on_progress, timeout))

    def cancel(self, job_id: str) -> Job:
        return self._run(calls.cancel(job_id))

    def retry(self, job_id: str, **changes: Any) -> Job:
        """A new job of the same scan with changed params."""
        return self._run(calls.retry(job_id, changes))

    def delete(self, job_id: str) -> None:
        return self._run(calls.delete(job_id))

    def download(self, job_id: str, name: str, target: str | Path) -> Path:
        """Write an artifact to ``target``, which appears whole and checked or not at all."""
        return self._run(calls.download(job_id, name, Path(target)))

    def options(self) -> Mapping[str, Any]:
        return self._run(calls.fetch_json("/v1/options"))

    def info(self) -> Mapping[str, Any]:
        return self._run(calls.fetch_json("/v1/info"))

    def events(self, job_id: str, after: int = 0) -> Iterator[Event]:
        """The job's events to its end; a broken stream goes on where it ended."""
        stream = EventStream(job_id, after)
        while not stream.ended:
            reply: httpx.Response | httpx.TransportError
            try:
                with self._http.stream(
                    "GET", stream.path, headers=stream.headers, timeout=STREAM_TIMEOUT
                ) as reply:
                    if not reply.is_success:
                        reply.read()
                    for line in reply.iter_lines():
                        event = stream.feed(line)
                        if event is not None:
                            yield event
            except httpx.TransportError as error:
                reply = error
            time.sleep(stream.pause_after(reply))

    def _run(self, flow: Flow[T]) -> T:
        reply: Reply = None
        while True:
            try:
                action = flow.send(reply)
            except StopIteration as end:
                return end.value
            if isinstance(action, Pause):
                time.sleep(action.seconds)
                reply = None
                continue
            try:
                if isinstance(action, Save):
                    reply = self._save(action)
                else:
                    reply = self._http.request(
                        action.method, action.path, headers=action.headers, **action.options
                    )
            except httpx.TransportError as error:
                reply = error

    def _save(self, action: Save) -> httpx.Response:
        with self._http.stream("GET", action.path, headers=action.headers) as reply:
            if not reply.is_success:
                reply.read()
                return reply
            with action.target.open("ab" if reply.status_code == 206 else "wb") as file:
                for chunk in reply.iter_bytes():
                    file.write(chunk)
        return reply
