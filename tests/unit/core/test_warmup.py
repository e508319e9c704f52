"""Warming up compiles all that a reconstruction runs, and knows when it was done."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from visco_core.kernels import Backend
from visco_core.kernels.cache import discard_stale
from visco_core.warmup import is_warm

COUNTS_WHAT_COMPILES_LATER = """
from visco_core.config import ReconstructionConfig
from visco_core.gallery import sphere, uniform_scan
from visco_core.kernels import choose_backend
from visco_core.kernels.cache import compiled_kernels
from visco_core.pointcloud import PointCloud
from visco_core.reconstruction import reconstruct
from visco_core.warmup import warm_up

backend = choose_backend("numba", "cpu", 2)
kernels = {n.split(".")[-1]: f for n, f in compiled_kernels(backend.kernels).items()}

def signatures():
    return {(name, signature) for name, kernel in kernels.items()
            for signature in kernel.signatures}

warm_up(backend)
before = signatures()
called = {name for name, _ in before}
print(sorted((kernels.keys() & set(backend.kernels.__all__)) - called))
cloud = uniform_scan(sphere(), 2000)
short = {"resolution": 128, "outer_steps": [1], "inner_steps": [2], "iterations": 1, "epochs": [1]}
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


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package of one kernel, whose helper is in another file."""
    folder = tmp_path / "kernels_of_one"
    folder.mkdir()
    (folder / "__init__.py").write_text("from kernels_of_one.main import one\n")
    (folder / "helper.py").write_text(
        "from numba import njit\n\n@njit(inline='always')\ndef helper():\n    return 1\n"
    )
    (folder / "main.py").write_text(
        "from numba import njit\nfrom kernels_of_one.helper import helper\n\n"
        "@njit(cache=True)\ndef one():\n    return helper()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    _forget()


def _forget() -> None:
    for name in [name for name in sys.modules if name.startswith("kernels_of_one")]:
        del sys.modules[name]
    importlib.invalidate_caches()


def _fresh() -> Backend:
    """The package as a process started now would see it."""
    _forget()
    kernels = importlib.import_module("kernels_of_one")
    discard_stale(kernels)
    return Backend("numba", "cpu", kernels, 1)


def test_kernels_are_warm_once_compiled_and_until_any_of_their_sources_changes(
    package: Path,
) -> None:
    assert not is_warm(_fresh())
    assert _fresh().kernels.one() == 1
    assert is_warm(_fresh())
    helper = package / "helper.py"
    helper.write_text(helper.read_text().replace("return 1", "return 1 + 1"))
    changed = _fresh()
    assert not is_warm(changed)
    assert changed.kernels.one() == 2


def test_kernels_whose_sources_did_not_change_are_not_compiled_again(package: Path) -> None:
    _fresh().kernels.one()
    os.utime(package / "helper.py", (1e9, 1e9))
    again = _fresh().kernels.one
    again()
    assert list(again.stats.cache_hits.values()) == [1]


def test_plain_kernels_are_always_warm(reference_backend: Backend) -> None:
    assert is_warm(reference_backend)
