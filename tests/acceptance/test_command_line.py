"""The `visco` command in processes of its own, as a terminal or a script would use it."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from visco_core.gallery import sample_scan_path
from visco_core.io import read_mesh
from visco_core.mesh_health import mesh_health

VISCO = [sys.executable, "-m", "visco_core.cli"]


def run(*words: object) -> subprocess.CompletedProcess[str]:
    command = [*VISCO, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def reconstructed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample scan's mesh, report and picture at 128 voxels."""
    folder = tmp_path_factory.mktemp("reconstructed")
    outputs = ("-o", folder / "mesh.glb", "--report", folder / "report.json")
    picture = ("--preview", folder / "picture.png")
    found = run("reconstruct", sample_scan_path(), *outputs, *picture, "--resolution", 128)
    assert found.returncode == 0, found.stderr
    assert "triangles" in found.stdout
    return folder


def test_the_sample_scan_becomes_one_closed_outward_mesh(reconstructed: Path) -> None:
    health = mesh_health(read_mesh(reconstructed / "mesh.glb"))
    assert health["watertight"]
    assert health["outward"]
    assert health["components"] == 1


def test_the_picture_shows_something(reconstructed: Path) -> None:
    from PIL import Image

    with Image.open(reconstructed / "picture.png") as picture:
        assert np.asarray(picture)[..., :3].std() > 20


def test_the_budget_runs_from_when_the_process_began() -> None:
    asked = "from visco_core.commands.reconstruct import _process_start as s; print(s())"
    before = time.monotonic()
    began = float(subprocess.run([sys.executable, "-c", asked], capture_output=True).stdout)
    tick = 0.01
    assert before - tick <= began <= time.monotonic()


def test_the_report_tells_settings_phases_losses_outcome_and_backend(reconstructed: Path) -> None:
    report = json.loads((reconstructed / "report.json").read_text())
    assert report["settings"]["resolution"] == 128
    assert report["backend"] == "native on cpu"
    assert report["outcome"]["code"] == "complete"
    phases = [phase["phase"] for phase in report["phases"]]
    assert phases[0] == "read"
    assert phases[-1] == "write"
    assert all(phase["seconds"] >= 0 for phase in report["phases"])
    assert report["peak_memory_bytes"] > 2**20
    last = report["steps"][-1]
    assert {"resolution", "step", "point", "normal", "viscosity"} <= set(last)


def test_evaluating_a_mesh_against_itself_finds_no_distance(reconstructed: Path) -> None:
    mesh = reconstructed / "mesh.glb"
    found = run("evaluate", mesh, "--gt", mesh, "--scan", sample_scan_path(), "--samples", 20_000)
    assert found.returncode == 0, found.stderr
    measured = json.loads(found.stdout)
    assert measured["point_to_triangle"]["gt_to_mesh"]["max"] < 1e-3
    assert measured["point_to_triangle"]["scan_to_mesh"]["mean"] < 1


@pytest.mark.parametrize(
    ("words", "advice"),
    [
        (["no-such-file.ply", "-o", "out.glb"], "check the path"),
        (["SCAN", "-o", "out.step"], "use one of"),
        (["SCAN", "-o", "out.glb", "--resolution", "32"], "between 64 and 1024"),
        (["SCAN", "-o", "out.glb", "--set", "lambdav=1"], "did you mean lambda_v"),
        (["SCAN", "-o", "out.glb", "--set", "lambda_v"], "NAME=VALUE"),
        (["SCAN", "-o", "out.glb", "--max-memory", "lots"], "4GiB"),
        (["SCAN", "-o", "out.glb", "--threads", "0"], "at least 1"),
        (["SCAN", "-o", "out.glb", "--backend", "native", "--device", "cuda"], "use device cpu"),
    ],
)
def test_bad_input_exits_2_with_one_sentence_and_leaves_nothing(
    words: list[str], advice: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = run("reconstruct", *(str(sample_scan_path()) if w == "SCAN" else w for w in words))
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1
    assert advice in found.stderr
    assert not list(tmp_path.iterdir())


def test_too_little_memory_exits_1_and_says_how_much_is_needed(tmp_path: Path) -> None:
    output = ("-o", tmp_path / "out.glb")
    found = run("reconstruct", sample_scan_path(), *output, "--max-memory", "10MiB")
    assert found.returncode == 1
    assert "MiB; raise the memory limit" in found.stderr
    assert not list(tmp_path.iterdir())


def test_a_memory_limit_in_between_gives_the_finest_level_that_fits(tmp_path: Path) -> None:
    outputs = ("-o", tmp_path / "out.ply", "--report", tmp_path / "report.json")
    limits = ("--resolution", 512, "--max-memory", "600MiB")
    found = run("reconstruct", sample_scan_path(), *outputs, *limits)
    assert found.returncode == 0, found.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["outcome"]["code"] == "memory_limited"
    assert report["peak_memory_bytes"] < 600 * 2**20
    assert mesh_health(read_mesh(tmp_path / "out.ply"))["watertight"]


def test_ctrl_c_stops_the_solve_and_leaves_nothing(tmp_path: Path) -> None:
    command = [*VISCO, "reconstruct", str(sample_scan_path()), "-o", str(tmp_path / "out.glb")]
    command += ["--profile", "paper"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(4)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=10)
    assert process.returncode == 1
    assert "stopped" in told
    assert not list(tmp_path.iterdir())


def test_every_option_is_listed_with_its_help() -> None:
    from visco_core.config import describe_options

    found = run("reconstruct", sample_scan_path(), "-o", "unused.glb", "--set", "help")
    assert found.returncode == 0
    for option in describe_options():
        assert option.name in found.stdout
        assert option.help in found.stdout
