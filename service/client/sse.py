"""Following a job's events: parsing, and going on after a cut, without a network."""

from __future__ import annotations

import json

import httpx

from service.client.flow import may_pass, pause_seconds, raise_for
from service.client.options import STALLS
from service.client.records import Event


class EventParser:
    """Feed it lines; it gives an event at each blank line that ends one."""

    def __init__(self) -> None:
        self._fields: dict[str, str] = {}

    def feed(self, line: str) -> Event | None:
        if line:
            name, _, value = line.partition(":")
            if name:
                self._fields[name] = value.removeprefix(" ")
            return None
        fields, self._fields = self._fields, {}
        if "id" not in fields or "data" not in fields:
            return None
        return Event(int(fields["id"]), fields.get("event", "message"), json.loads(fields["data"]))


class EventStream:
    """What both clients know of a stream that may need several connections."""

    def __init__(self, job_id: str, after: int) -> None:
        self.path = f"/v1/jobs/{job_id}/events"
        self.ended = False
        self._after = after
        self._stalls = 0
        self._parser = EventParser()

    @property
    def headers(self) -> dict[str, str]:
        return {"Last-Event-ID": str(self._after)}

    def feed(self, line: str) -> Event | None:
        event = self._parser.feed(line)
        if event is not None:
            self._after, self._stalls = event.sequence, 0
            self.ended = event.is_last
        return event

    def pause_after(self, reply: httpx.Response | httpx.TransportError) -> float:
        """Seconds until the next connection; raises what an answer that will not change means."""
        self._parser = EventParser()
        if isinstance(reply, httpx.Response) and reply.status_code == 204:
            self.ended = True
        if self.ended:
            return 0.0
        self._stalls += 1
        if self._stalls > STALLS or not may_pass(reply):
            raise_for(reply)
        return pause_seconds(self._stalls, reply)
