"""Warming up compiles all that a reconstruction runs, and knows when it was done."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

from visco_core.kernels import Backend
from visco_core.warmup import is_warm

COUNTS_WHAT_COMPILES_LATER = """
from numba.core.dispatcher import Dispatcher
from visco_core.config import ReconstructionConfig
from visco_core.gallery import sphere, uniform_scan
from visco_core.kernels import choose_backend
from visco_core.pointcloud import PointCloud
from visco_core.reconstruction import reconstruct
from visco_core.warmup import warm_up

backend = choose_backend("numba", "cpu", 2)
kernels = {n: f for n, f in vars(backend.kernels).items() if isinstance(f, Dispatcher)}

def signatures():
    return {(name, signature) for name, kernel in kernels.items()
            for signature in kernel.signatures}

warm_up(backend)
before = signatures()
called = {name for name, _ in before}
print(sorted(name for name in kernels.keys() - called if not name.startswith("_")))
cloud = uniform_scan(sphere(), 2000)
short = {"resolution": 92, "outer_steps": [1], "inner_steps": [2], "iterations": 1, "epochs": [1]}
for options in ({}, {"normals": "estimate"}, {"profile": "paper"}, {"lambda_c": 1e-6}):
    config = ReconstructionConfig.from_options({**short, **options}, backend="numba")
    reconstruct(PointCloud(cloud.points * 3 + 1, cloud.normals), config)
print(sorted(name for name, _ in signatures() - before))
"""


def test_after_warming_up_nothing_is_left_to_compile() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", COUNTS_WHAT_COMPILES_LATER],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["[]", "[]"]


def test_kernels_are_warm_once_compiled_and_until_their_source_changes(tmp_path: Path) -> None:
    source = tmp_path / "kernel_of_one.py"
    source.write_text("from numba import njit\n\n@njit(cache=True)\ndef one():\n    return 1\n")
    spec = importlib.util.spec_from_file_location("kernel_of_one", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    backend = Backend("numba", "cpu", module)
    assert not is_warm(backend)
    assert module.one() == 1
    assert is_warm(backend)
    later = source.stat().st_mtime + 1e6
    os.utime(source, (later, later))
    assert not is_warm(backend)


def test_plain_kernels_are_always_warm(reference_backend: Backend) -> None:
    assert is_warm(reference_backend)
