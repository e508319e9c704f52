"""`visco serve`: broker, API and workers as child processes of one that only watches them."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import httpx

from service.broker import broker_command
from service.db.migrate import open_database
from service.settings import Settings
from visco_core.errors import InputError

log = logging.getLogger(__name__)
_GRACE_SECONDS = 4.0
_WATCH_SECONDS = 0.2
_READY_SECONDS = 60.0
# A child that dies again and again is restarted ever more slowly.
_BACKOFF_SECONDS = (0.2, 1.0, 3.0, 10.0)
_STABLE_SECONDS = 60.0


class CannotServe(InputError):
    """The data folder or the port cannot be used; the message says what to do."""

    def __init__(self, detail: str) -> None:
        super().__init__("cannot_serve", detail)


@dataclass
class Child:
    """One process that is started again when it dies. It leads a session of its own, so that
    Ctrl-C reaches the supervisor alone, and its own children end with it."""

    name: str
    command: Sequence[str]
    environment: Mapping[str, str] = field(default_factory=dict)
    process: subprocess.Popen[bytes] | None = None
    failures: int = 0
    started_at: float = 0.0
    restart_at: float = 0.0

    def start(self) -> None:
        self.started_at = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "service.guarded", str(os.getpid()), *self.command],
            env={**os.environ, **self.environment},
            stdin=subprocess.DEVNULL,
            # Standard output is kept for the one line that says where the service is.
            stdout=2,
            start_new_session=True,
        )

    def watch(self) -> None:
        """Start the process again when it has died."""
        now = time.monotonic()
        if self.process is None:
            if now >= self.restart_at:
                self.start()
        elif self.process.poll() is not None:
            if now - self.started_at > _STABLE_SECONDS:
                self.failures = 0
            delay = _BACKOFF_SECONDS[min(self.failures, len(_BACKOFF_SECONDS) - 1)]
            log.warning("%s ended with %s; it starts again", self.name, self.process.returncode)
            self.failures += 1
            self.process, self.restart_at = None, now + delay

    def ask_to_end(self) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)

    def end(self, deadline: float) -> None:
        """Wait until the deadline, then kill the process and everything it started."""
        if self.process is None:
            return
        try:
            self.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            log.warning("%s did not end in time and is killed", self.name)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


class Supervisor:
    """Starts everything, says when it is ready, and ends everything within five seconds."""

    def __init__(self, settings: Settings, workers: int | None, device: str) -> None:
        """Raises CannotServe."""
        self.settings = settings = _with_port(settings)
        _check_folder(settings.data_dir)
        variables = settings.environment()
        python = [sys.executable, "-m", "visco_core.cli"]
        self.broker = None
        if not settings.redis_url:
            self.broker = Child("broker", broker_command(settings))
        self.api = Child("api", [*python, "api"], variables)
        count = workers or (1 if device == "cpu" else max(1, len(_gpus())))
        self.workers = [
            Child(
                f"worker {number}",
                [*python, "worker", "--device", device],
                variables | _share(number, count, settings),
            )
            for number in range(count)
        ]
        self._asked = False

    @property
    def children(self) -> list[Child]:
        first = [] if self.broker is None else [self.broker]
        return [*first, self.api, *self.workers]

    def run(self) -> int:
        """Serve until a signal asks to end. Raises CannotServe."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)
        with _only_one(self.settings.data_dir):
            _check_port(self.settings)
            open_database(self.settings.sqlalchemy_url).dispose()
            try:
                for child in self.children:
                    child.start()
                self._announce()
                while not self._asked:
                    for child in self.children:
                        child.watch()
                    time.sleep(_WATCH_SECONDS)
            finally:
                self._end()
        return 0

    def _ask(self, *_: object) -> None:
        self._asked = True

    def _announce(self) -> None:
        """Wait until the API and all that it needs answer, then say where it is."""
        address = f"http://{_reachable(self.settings.host)}:{self.settings.port}"
        deadline = time.monotonic() + _READY_SECONDS
        while not self._asked and time.monotonic() < deadline:
            for child in self.children:
                child.watch()
            if self._is_ready(address):
                print(f"VisCo is ready on {address}; Ctrl-C ends it.", flush=True)
                return
            time.sleep(_WATCH_SECONDS / 2)
        if not self._asked:
            log.error("The service is not ready after %.0f s; it goes on trying", _READY_SECONDS)

    def _is_ready(self, address: str) -> bool:
        try:
            return httpx.get(f"{address}/readyz", timeout=1, trust_env=False).is_success
        except httpx.HTTPError:
            return False

    def _end(self) -> None:
        """Workers give their jobs back while the database and the broker are still there."""
        deadline = time.monotonic() + _GRACE_SECONDS
        for child in [*self.workers, self.api]:
            child.ask_to_end()
        for child in [*self.workers, self.api]:
            child.end(deadline)
        if self.broker is not None:
            self.broker.ask_to_end()
            self.broker.end(max(deadline, time.monotonic() + 0.5))


def _with_port(settings: Settings) -> Settings:
    """Port 0 asks for any free one; it is chosen here, so that a restarted API gets the same."""
    if settings.port:
        return settings
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.bind((settings.host, 0))
        return settings.model_copy(update={"port": probe.getsockname()[1]})


def _check_folder(folder: Path) -> None:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        raise CannotServe(
            f"{folder} cannot be written to ({error.strerror}); choose another with --data-dir."
        ) from None


def _check_port(settings: Settings) -> None:
    """Another program's answers on the port would look like those of the API."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((settings.host, settings.port))
        except OSError as error:
            raise CannotServe(
                f"Port {settings.port} of {settings.host} cannot be used ({error.strerror}); "
                "choose another with --port."
            ) from None


def _gpus() -> list[str]:
    """What CUDA_VISIBLE_DEVICES may name, told without a driver's library."""
    chosen = os.environ.get("CUDA_VISIBLE_DEVICES")
    if chosen is not None:
        return [name for name in chosen.split(",") if name]
    return [path.name.removeprefix("nvidia") for path in sorted(Path("/dev").glob("nvidia[0-9]*"))]


def _share(number: int, count: int, settings: Settings) -> dict[str, str]:
    """A worker's part of the machine: one GPU, and its share of the cores."""
    variables = {}
    gpus = _gpus()
    if gpus:
        variables["CUDA_VISIBLE_DEVICES"] = gpus[number % len(gpus)]
    if count > 1 and not settings.worker_threads:
        variables["VISCO_WORKER_THREADS"] = str(max(1, (os.cpu_count() or 1) // count))
    return variables


def _reachable(host: str) -> str:
    if host in ("0.0.0.0", "::"):
        return "127.0.0.1"
    return f"[{host}]" if ":" in host else host


@contextlib.contextmanager
def _only_one(folder: Path) -> Iterator[IO[str]]:
    with (folder / "serve.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise CannotServe(
                f"Another `visco serve` uses {folder}; stop it or choose another --data-dir."
            ) from None
        yield file
