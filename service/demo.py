"""``make demo``: the service from start to stop, and the sample scan, as any client uses it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from service.client import Client, Job

ARTIFACTS = ("mesh.glb", "mesh.ply", "preview.png")
STOP_SECONDS = 15


def main(arguments: Sequence[str] | None = None) -> int:
    """Leaves the sample's mesh and picture in the folder that is given."""
    from visco_core.gallery import sample_scan_path

    (folder,) = arguments or sys.argv[1:]
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    scan = sample_scan_path()
    with tempfile.TemporaryDirectory() as data, serving(Path(data)) as url, Client(url) as client:
        print(f"The service runs on {url}; its dashboard is there too.")
        job = client.submit(scan, label="demo", outputs=list(ARTIFACTS))
        print(f"Submitted {scan.name} as job {job.id}.")
        teller = _Teller()
        client.wait(job.id, teller.tell)
        for name in ARTIFACTS:
            print(f"Saved {client.download(job.id, name, target / name)}")
    print("Stopped the service. To keep one running: make serve")
    return 0


@contextmanager
def serving(data: Path) -> Iterator[str]:
    """`visco serve` on a free port with its data in ``data``; yields its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    command = [sys.executable, "-m", "visco_core.cli", "serve", "--port", port, "--data-dir", data]
    # The story is told below; of the service's own log only trouble is of interest.
    environment = {"VISCO_LOG_LEVEL": "warning", **os.environ}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        yield _address(server)
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(STOP_SECONDS)


def _address(server: subprocess.Popen[str]) -> str:
    for line in server.stdout or ():
        for word in line.split():
            if word.startswith("http://"):
                return word.rstrip(".,;")
    raise SystemExit(f"The service ended with exit code {server.wait()} before it was ready.")


class _Teller:
    """One line for each change of what the job is doing."""

    def __init__(self) -> None:
        self._last = ""

    def tell(self, job: Job) -> None:
        progress = job.raw.get("progress") or {}
        phase, resolution = progress.get("phase", job.status), progress.get("resolution")
        words = f"{phase} at {resolution}³" if resolution else phase
        if words != self._last:
            print(f"  {job.fraction:4.0%} {words}", flush=True)
            self._last = words


if __name__ == "__main__":
    raise SystemExit(main())
