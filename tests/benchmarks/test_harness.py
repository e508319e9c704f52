"""The benchmark harness, run as a user runs it, with programs whose result is known."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from visco_core import gallery
from visco_core.gallery import uniform_scan, write_scan
from visco_core.io import write_mesh

ROOT = Path(__file__).resolve().parents[2]


def run_benchmark(name: str, *arguments: str) -> str:
    command = [sys.executable, "-m", f"tests.benchmarks.{name}", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_srb_ranks_a_perfect_a_worse_and_a_failing_program(data: Path) -> None:
    printed = run_benchmark(
        "srb",
        *("--data", str(data), "--work", str(data / "work"), "--json", str(data / "report.json")),
        *("--methods", "", "--samples", "20000", "--repeats", "2", "--no-warm-up"),
        *("--command", f"perfect=cp {data}/gt/ball_gt_mesh.ply {{out}}"),
        *("--command", f"larger=cp {data}/larger.ply {{out}}"),
        *("--command", "failing={python} -c \"raise SystemExit('no surface')\""),
    )
    perfect, larger, failing = json.loads((data / "report.json").read_text())["scores"]
    assert perfect["metrics"]["point_to_triangle"]["gt_to_mesh"]["max"] < 1e-6
    assert larger["metrics"]["point_to_triangle"]["mesh_to_gt"]["mean"] == pytest.approx(
        0.1, rel=0.02
    )
    assert larger["health"]["watertight"]
    assert failing["metrics"] is None
    assert [run["problem"] for run in failing["runs"]] == ["no surface"] * 2
    assert "| ball | larger " in printed
    assert "ball, failing: no surface" in printed


def test_a_program_that_hangs_is_stopped_with_all_its_children(data: Path) -> None:
    run_benchmark(
        "srb",
        *("--data", str(data), "--work", str(data / "work"), "--json", str(data / "report.json")),
        *("--methods", "", "--timeout", "0.5", "--no-warm-up"),
        *("--command", f"slow=sh -c 'echo $$ > {data}/pid; exec sleep 60'"),
    )
    (slow,) = json.loads((data / "report.json").read_text())["scores"]
    assert slow["runs"][0]["problem"] == "not finished after 0.5 s"
    left = [process.pid for process in psutil.process_iter() if process.status() != "zombie"]
    assert int((data / "pid").read_text()) not in left


def test_peak_memory_is_the_programs_own(data: Path) -> None:
    hungry = "x=bytearray(150_000_000);x[::4096]=b'x'*len(x[::4096])"
    run_benchmark(
        "srb",
        *("--data", str(data), "--work", str(data / "work"), "--json", str(data / "report.json")),
        *("--methods", "", "--samples", "1000", "--no-warm-up"),
        *("--command", "modest={python} -S -c pass"),
        *("--command", f'hungry={{python}} -S -c "{hungry}"'),
    )
    modest, hungry = json.loads((data / "report.json").read_text())["scores"]
    assert modest["runs"][0]["peak_bytes"] < 40e6
    assert 150e6 < hungry["runs"][0]["peak_bytes"] < 200e6


def test_synthetic_prints_a_row_for_each_noise_and_marks_the_best(tmp_path: Path) -> None:
    write_mesh(gallery.torus().mesh(96), tmp_path / "ring.ply")
    write_mesh(gallery.torus().mesh(48), tmp_path / "fine.ply")
    write_mesh(gallery.torus().mesh(24), tmp_path / "rough.ply")
    printed = run_benchmark(
        "synthetic",
        *(
            "--meshes",
            str(tmp_path),
            "--surfaces",
            "ring",
            "--points",
            "300",
            "--noise",
            "0,0.01",
            "--methods",
            "",
        ),
        *("--work", str(tmp_path / "work"), "--samples", "2000", "--no-warm-up"),
        *("--command", f"rough=cp {tmp_path}/rough.ply {{out}}"),
        *("--command", f"fine=cp {tmp_path}/fine.ply {{out}}"),
    )
    errors = printed.split("Largest")[0]
    rows = [line.split("|")[1:-1] for line in errors.splitlines() if line.startswith("| ring")]
    assert [row[2].strip() for row in rows] == ["0 %", "1 %"]
    assert all("**" in row[4] and "**" not in row[3] for row in rows)


def test_odd_scans_are_made_and_scored(tmp_path: Path) -> None:
    write_mesh(gallery.two_bodies().mesh(48), tmp_path / "truth.ply")
    printed = run_benchmark(
        "odd",
        *("--cases", "two-bodies", "--methods", "", "--samples", "2000", "--no-warm-up"),
        *("--work", str(tmp_path / "work"), "--command", f"copy=cp {tmp_path}/truth.ply {{out}}"),
    )
    row = next(line for line in printed.splitlines() if line.startswith("| two-bodies"))
    cells = [cell.strip() for cell in row.split("|")[1:-1]]
    assert float(cells[2]) < 1.0
    assert cells[-2:] == ["2", "yes"]


def test_the_worth_of_confidence_is_told_in_tenths(data: Path) -> None:
    write_scan(uniform_scan(gallery.torus(), 8000), data / "scans" / "ring.ply")
    write_mesh(gallery.torus().mesh(64), data / "gt" / "ring_gt_mesh.ply")
    printed = run_benchmark(
        "confidence", *("--data", str(data), "--scans", "ring", "--resolution", "64")
    )
    rows = [line.split("|")[1:-1] for line in printed.splitlines() if line.startswith("| ring")]
    confidence, error = ([float(cell) for cell in row[2:]] for row in rows)
    assert len(confidence) == len(error) == 10
    assert confidence == sorted(confidence)
    assert 0 < max(error) < 5


def test_the_profile_fast_ends_at_the_energy_of_a_plain_solver(tmp_path: Path) -> None:
    printed = run_benchmark("convergence", "--scans", "bracket", "--work", str(tmp_path))
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in printed.splitlines()]
    at_the_end = {row[0]: float(row[5]) for row in rows if row and " × " in row[0]}
    assert len(at_the_end) > 5
    assert at_the_end["BPX, 8ε to ε, 11 × 30"] < 1.001 * at_the_end["diagonal, 60 × 40"]
