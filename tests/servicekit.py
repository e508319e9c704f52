"""What the tests of the service share: settings, a running API, a running broker, small scans."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import uvicorn

from service.api.front_page import BUILD
from service.broker import broker_command
from service.db import Database, migrate, new_id, utc_now
from service.jobs.model import Event, Job
from service.jobs.repository import JobRepository
from service.main import create_app
from service.settings import Settings
from service.uploads.model import Upload


def make_settings(folder: Path, **changes: Any) -> Settings:
    """Settings of a service that lives in ``folder`` and whose clocks tick fast."""
    fast = {
        "heartbeat_seconds": 0.3,
        "lease_seconds": 2.0,
        "reap_seconds": 0.3,
        "port": free_port(),
    }
    return Settings(**{"data_dir": folder / "data", **fast, **changes})


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def open_database(settings: Settings) -> Database:
    return migrate.open_database(settings.sqlalchemy_url)


def sphere_scan(points: int = 200, scale: float = 1.0) -> bytes:
    """An ASCII PLY of a sphere with normals, evenly covered (Fibonacci lattice)."""
    index = np.arange(points) + 0.5
    height = 1 - 2 * index / points
    angle = np.pi * (1 + 5**0.5) * index
    flat = np.sqrt(1 - height**2)
    normals = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    rows = np.column_stack([normals * scale, normals])
    body = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in rows)
    header = f"ply\nformat ascii 1.0\nelement vertex {points}\n{names}end_header\n"
    return f"{header}{body}\n".encode()


def add_job(database: Database, owner: str = "local", **fields: Any) -> Job:
    """A queued job over an upload without bytes, put into the database directly."""
    upload = Upload(
        id=new_id(), owner=owner, name="scan.ply", size=10, offset=10, key="uploads/none/scan.ply",
        sha256="0" * 64, expires_at=utc_now(),
    )  # fmt: skip
    job = Job(**{"owner": owner, "params": {}, "device_class": "cpu", "upload": upload, **fields})
    with database.transaction() as unit:
        unit.session.add(upload)
        JobRepository(unit.session).add(job)
    return job


def until(condition: Callable[[], object], seconds: float = 20) -> None:
    """Ask again and again until the condition holds; fails after ``seconds``."""
    deadline = time.monotonic() + seconds
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline, "it did not come true in time"
        pause.wait(0.02)


@contextlib.contextmanager
def running_api(settings: Settings, dashboard: Path = BUILD) -> Iterator[httpx.Client]:
    """The real application behind a real socket, and a client for it."""
    open_database(settings).dispose()
    config = uvicorn.Config(
        create_app(settings, dashboard),
        port=settings.port,
        log_config=None,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    listening = threading.Event()
    startup = server.startup

    async def announced_startup(sockets: list[socket.socket] | None = None) -> None:
        await startup(sockets)
        listening.set()

    server.startup = announced_startup  # type: ignore[method-assign]
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        assert listening.wait(20), "the API did not start"
        with httpx.Client(base_url=f"http://127.0.0.1:{settings.port}", timeout=20) as client:
            yield client
    finally:
        server.should_exit = True
        thread.join()


@contextlib.contextmanager
def running_process(
    command: Sequence[object], ready: bytes, stop: signal.Signals = signal.SIGTERM, **options: Any
) -> Iterator[subprocess.Popen[bytes]]:
    """A server as a process of its own; it is there once it has printed ``ready``.

    Raises TimeoutExpired where it does not end within 20 s of the signal ``stop``, and kills it.
    """
    process = subprocess.Popen(
        [str(word) for word in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        **options,
    )
    assert process.stdout is not None
    with process.stdout:
        said = []
        for line in process.stdout:
            said.append(line)
            if ready in line:
                break
        else:
            process.wait()
            raise AssertionError(f"{command[0]} did not start: {b''.join(said[-5:]).decode()}")
        drain = threading.Thread(target=process.stdout.read)
        drain.start()
        try:
            yield process
        finally:
            process.send_signal(stop)
            try:
                process.wait(20)
            finally:
                process.kill()
                drain.join()


@contextlib.contextmanager
def running_broker(settings: Settings) -> Iterator[subprocess.Popen[bytes]]:
    """The embedded broker of these settings."""
    command = [*broker_command(settings), "--loglevel", "notice", "--logfile", ""]
    with running_process(command, b"eady to accept connections") as process:
        yield process


def write_events_at_once(database: Database) -> list[int]:
    """Let many threads store events of one job; gives the events' numbers in order."""
    job = add_job(database)

    def write(_: int) -> None:
        with database.transaction() as unit:
            repository = JobRepository(unit.session)
            locked = repository.lock(job.id)
            assert locked is not None
            repository.record(locked, "progress", {})

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(40)))
    with database.read() as session:
        query = session.query(Event).where(Event.job_id == job.id).order_by(Event.sequence)
        return [event.sequence for event in query]


def submit(client: httpx.Client, scan: bytes | None = None, headers: Any = None, **params: Any):
    """POST a small scan; returns the response."""
    return client.post(
        "/v1/jobs",
        files={"file": ("scan.ply", sphere_scan() if scan is None else scan)},
        data={"params": json.dumps(params)},
        headers=headers,
    )


def read_events(
    client: httpx.Client, job_id: str, after: int = 0, until: str | None = None
) -> list[dict[str, Any]]:
    """Follow a job's events to their end, or to the first of type ``until``."""
    events: list[dict[str, Any]] = []
    headers = {"Last-Event-ID": str(after)} if after else {}
    with client.stream("GET", f"/v1/jobs/{job_id}/events", headers=headers, timeout=180) as answer:
        event: dict[str, Any] = {}
        for line in answer.iter_lines():
            name, _, value = line.partition(": ")
            if name in ("id", "event", "data"):
                event[name] = json.loads(value) if name == "data" else value
            if not line and "id" in event:
                events.append(event)
                if event["event"] == until:
                    return events
                event = {}
    return events
