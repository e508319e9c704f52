"""The methods that are compared, each a command from file to file, and what a run of one costs."""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_LAUNCH = Path(__file__).with_name("launch.py")
_ROOT = Path(__file__).resolve().parents[2]
PEERS = {
    "open3d": "{python} -m tests.benchmarks.open3d_poisson {scan} {out} --depth {depth}",
    "pymeshlab": "{python} -m tests.benchmarks.pymeshlab_methods poisson {scan} {out} "
    "--depth {depth}",
    "apss": "{python} -m tests.benchmarks.pymeshlab_methods apss {scan} {out} --depth {depth}",
}
_OURS = "{visco} reconstruct {scan} -o {out} --resolution {resolution}"


@dataclass(frozen=True)
class Method:
    """A way to turn a scan into a mesh.

    command: a shell-like line with the fields {scan}, {out}, {resolution}, {depth}, {python} and
    {visco}.
    """

    name: str
    command: str

    def arguments(self, scan: Path, out: Path, resolution: int) -> list[str]:
        fields = {
            "scan": scan,
            "out": out,
            "resolution": resolution,
            "depth": math.ceil(math.log2(resolution)),
            "python": sys.executable,
            "visco": Path(sysconfig.get_path("scripts")) / "visco",
        }
        return [word.format(**fields) for word in shlex.split(self.command)]


@dataclass(frozen=True)
class Run:
    """What one run took; ``problem`` says why there is no mesh, or is empty."""

    seconds: float
    cpu_seconds: float
    peak_bytes: int
    problem: str


def add_method_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--methods",
        default="open3d,visco",
        help=f"comma-separated, the first is the baseline: visco, {', '.join(PEERS)}",
    )
    parser.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="NAME=OPTIONS",
        help="ours with more options, for example: smooth='--set lambda_v=1e-3'",
    )
    parser.add_argument(
        "--command",
        action="append",
        default=[],
        metavar="NAME=COMMAND",
        help="any other program, for example: kazhdan='PoissonRecon --in {scan} --out {out} "
        "--depth {depth}'",
    )
    parser.add_argument("--resolution", type=int, default=256, help="voxels a side; depth: log2")


def ours(name: str, options: str = "") -> Method:
    """VisCo with ``options`` of ``visco reconstruct``; of one given twice, the last counts."""
    return Method(name, f"{_OURS} {options}")


def methods_of(arguments: argparse.Namespace) -> list[Method]:
    """The methods that the command line asks for, the baseline first."""
    known = {**PEERS, "visco": _OURS}
    methods = []
    for name in filter(None, arguments.methods.split(",")):
        if name not in known:
            raise SystemExit(f"there is no method {name!r}; known are {', '.join(known)}")
        methods.append(Method(name, known[name]))
    for text in arguments.variant:
        name, _, options = text.partition("=")
        methods.append(ours(name, options))
    for text in arguments.command:
        name, _, command = text.partition("=")
        methods.append(Method(name, command))
    return methods


def run_method(method: Method, scan: Path, out: Path, resolution: int, timeout: float) -> Run:
    """One run in a fresh process; a method that fails is a result, not an error."""
    out.unlink(missing_ok=True)
    cost_file = out.with_suffix(".cost.json")
    command = [sys.executable, "-I", "-S", str(_LAUNCH), str(cost_file)]
    return _run([*command, *method.arguments(scan, out, resolution)], cost_file, out, timeout)


def _run(command: Sequence[str], cost_file: Path, out: Path, timeout: float) -> Run:
    running = subprocess.Popen(
        command,
        cwd=_ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    try:
        printed, _ = running.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        os.killpg(running.pid, signal.SIGKILL)
        running.communicate()
        return Run(timeout, 0.0, 0, f"not finished after {timeout:g} s")
    if running.returncode:
        return Run(0.0, 0.0, 0, _last_line(printed))
    cost = json.loads(cost_file.read_text(encoding="utf-8"))
    cost_file.unlink()
    problem = ""
    if cost["exit_code"] or not out.is_file():
        problem = _last_line(printed) or f"exit code {cost['exit_code']}, no mesh"
    return Run(cost["seconds"], cost["cpu_seconds"], cost["peak_bytes"], problem)


def _last_line(output: str) -> str:
    lines = output.strip().splitlines()
    return lines[-1][:200] if lines else ""
