"""`visco serve` as a user runs it: real processes, real scans, Ctrl-C and kill -9."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest
from servicekit import free_port, read_events, sphere_scan, submit, until
from workerkit import ENDLESS

from service.client import Client

SMALL = {"resolution": 64, "outputs": ["mesh.ply"]}


@dataclass
class Served:
    """A running `visco serve`, and its child processes by what they do."""

    process: subprocess.Popen[str]
    api: httpx.Client

    def children(self) -> list[psutil.Process]:
        return psutil.Process(self.process.pid).children(recursive=True)

    def child(self, word: str) -> psutil.Process:
        """The direct child with this word, or program, in its command line."""
        found = [
            child
            for child in psutil.Process(self.process.pid).children()
            if word == child.name() or word in child.cmdline()
        ]
        assert len(found) == 1, found
        return found[0]

    def interrupt(self) -> int:
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(20)


def start(folder: Path, port: int) -> Served:
    process = subprocess.Popen(
        [sys.executable, "-m", "visco_core.cli", "serve"],
        env={**os.environ, "VISCO_DATA_DIR": str(folder), "VISCO_PORT": str(port)},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    first = process.stdout.readline()
    if "is ready on" not in first:
        process.terminate()
        rest, _ = process.communicate()
        pytest.fail(f"visco serve said: {first}{rest}")
    return Served(process, httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30))


def still_running(processes: list[psutil.Process]) -> list[psutil.Process]:
    """Those that have not ended; whether init has already taken note does not matter."""
    return [p for p in processes if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    running = start(tmp_path / "data", free_port())
    yield running
    stop(running)


def stop(running: Served) -> None:
    running.api.close()
    if running.process.poll() is None:
        running.interrupt()
    assert running.process.stdout is not None
    running.process.stdout.close()


@pytest.mark.realdata
def test_a_real_scan_goes_in_and_a_mesh_comes_out(
    served: Served, realdata: Path, tmp_path: Path
) -> None:
    seen: list[float] = []
    with Client(str(served.api.base_url)) as client:
        job = client.submit(realdata / "srb/scans/dc.ply", resolution=64, label="dc")
        done = client.wait(job.id, lambda job: seen.append(job.fraction))
        for name in ("mesh.glb", "mesh.ply", "preview.png", "report.json"):
            assert client.download(job.id, name, tmp_path / name).stat().st_size > 1000
    assert seen == sorted(seen)
    assert done.raw["result"]["outcome"]["code"] == "complete"
    assert done.raw["result"]["faces"] > 5000


@pytest.mark.realdata
def test_a_time_budget_gives_the_finest_level_that_it_allows(
    served: Served, realdata: Path
) -> None:
    scan = (realdata / "srb/scans/dc.ply").read_bytes()
    wanted = {"resolution": 1024, "budget_seconds": 3, "outputs": ["mesh.ply"]}
    job_id = submit(served.api, scan, **wanted).json()["id"]
    assert read_events(served.api, job_id)[-1]["event"] == "succeeded"
    job = served.api.get(f"/v1/jobs/{job_id}").json()
    assert job["result"]["outcome"]["code"] == "budget_exhausted"
    assert 64 <= job["result"]["outcome"]["resolution"] < 1024
    assert job["result"]["faces"] > 5000
    mesh = served.api.get(f"/v1/jobs/{job_id}/artifacts/mesh.ply").content
    assert mesh.startswith(b"ply\nformat binary_little_endian")


def test_ctrl_c_ends_every_child_and_queued_jobs_wait_for_the_next_start(
    served: Served, tmp_path: Path
) -> None:
    solving = submit(served.api, sphere_scan(2000), **ENDLESS).json()["id"]
    queued = submit(served.api, sphere_scan(2000), **SMALL).json()["id"]
    until(lambda: served.api.get(f"/v1/jobs/{solving}").json()["status"] == "running", 180)
    children = served.children()
    assert served.interrupt() == 0
    assert not still_running(children)
    again = start(tmp_path / "data", free_port())
    try:
        again.api.post(f"/v1/jobs/{solving}/cancel")
        assert read_events(again.api, queued)[-1]["event"] == "succeeded"
        assert read_events(again.api, solving)[-1]["event"] == "cancelled"
        attempts = again.api.get(f"/v1/jobs/{solving}").json()["attempts"]
        assert attempts[0]["outcome"] == "released"
    finally:
        stop(again)


def test_killing_api_broker_and_worker_loses_nothing(served: Served) -> None:
    job_id = submit(served.api, sphere_scan(2000), **ENDLESS).json()["id"]
    until(lambda: served.api.get(f"/v1/jobs/{job_id}").json()["progress"], 180)
    with ThreadPoolExecutor(1) as pool, Client(str(served.api.base_url)) as client:
        followed = pool.submit(lambda: [event.sequence for event in client.events(job_id)])
        kill_and_recover(served, job_id)
        served.api.post(f"/v1/jobs/{job_id}/cancel")
        events = read_events(served.api, job_id)
        assert events[-1]["event"] == "cancelled"
        assert followed.result(60) == list(range(1, len(events) + 1))


def kill_and_recover(served: Served, job_id: str) -> None:
    """Kill -9 on all three, and wait until the job runs again."""
    killed = [served.child(word) for word in ("api", "valkey-server", "worker")]
    before = {child.pid for child in killed}
    for child in killed:
        child.kill()

    def all_back() -> bool:
        now = psutil.Process(served.process.pid).children()
        if len(now) < 3 or before & {child.pid for child in now}:
            return False
        try:
            return served.api.get("/readyz").is_success
        except httpx.TransportError:
            return False

    until(all_back, 180)

    def runs_again() -> bool:
        job = served.api.get(f"/v1/jobs/{job_id}").json()
        return len(job["attempts"]) == 2 and bool(job["progress"])

    until(runs_again, 180)


def test_a_supervisor_that_is_killed_leaves_no_process_behind(served: Served) -> None:
    children = served.children()
    served.process.kill()
    served.process.wait()
    until(lambda: not still_running(children), 30)


def test_a_second_serve_on_the_same_folder_is_refused(served: Served, tmp_path: Path) -> None:
    second = subprocess.run(
        [sys.executable, "-m", "visco_core.cli", "serve", "--data-dir", tmp_path / "data"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert second.returncode == 2
    assert "Another `visco serve`" in second.stderr


def test_a_taken_port_is_refused(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "visco_core.cli", "serve", "--port", port]
        done = subprocess.run(
            [*command, "--data-dir", tmp_path], capture_output=True, text=True, timeout=60
        )
    assert done.returncode == 2
    assert f"Port {port}" in done.stderr


def test_the_command_line_submits_lists_and_downloads(served: Served, tmp_path: Path) -> None:
    scan, mesh = tmp_path / "part.ply", tmp_path / "part.glb"
    scan.write_bytes(sphere_scan(2000))
    url = ["--url", str(served.api.base_url)]

    def visco(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "visco_core.cli", *map(str, words), *url]
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    done = visco("submit", scan, "--wait", "-o", mesh, "--set", "resolution=64", "--label", "p")
    assert (done.returncode, done.stderr) == (0, "")
    assert mesh.read_bytes().startswith(b"glTF")
    job_id = done.stdout.strip()
    assert job_id in visco("jobs", "--status", "succeeded").stdout
    assert visco("download", job_id, "-o", tmp_path / "copy.glb").returncode == 0
    assert (tmp_path / "copy.glb").read_bytes() == mesh.read_bytes()
    refused = visco("submit", scan, "--set", "resolution=1")
    assert refused.returncode == 2
    assert "params.resolution" in refused.stderr
    assert visco("submit", scan, "--set", "resolution").returncode == 2
    assert visco("submit", scan, "-o", "mesh.stl").returncode == 2
    assert visco("submit", tmp_path / "none.ply").returncode == 2
    finished = visco("cancel", job_id)
    assert (finished.returncode, finished.stdout) == (2, "")


def test_a_watched_folder_gets_its_meshes(served: Served, tmp_path: Path) -> None:
    folder = tmp_path / "scans"
    folder.mkdir()
    watching = subprocess.Popen(
        [
            sys.executable, "-m", "visco_core.cli", "watch", folder, "--settle", "0.1",
            "--interval", "0.2", "--set", "resolution=64", "--url", str(served.api.base_url),
        ]
    )  # fmt: skip
    try:
        (folder / "part.ply").write_bytes(sphere_scan(2000))
        until((folder / "part.report.json").exists, 90)
    finally:
        watching.send_signal(signal.SIGTERM)
        assert watching.wait(20) == 0
    assert (folder / "part.mesh.glb").read_bytes().startswith(b"glTF")
    assert len(served.api.get("/v1/jobs").json()["jobs"]) == 1
