"""The package's public names are those it promises, and reading settings stays cheap."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import visco_core

HEAVY = {"torch", "trimesh", "scipy", "skimage", "igl", "fast_simplification", "PIL"}

PROMISED = {
    "Budget",
    "InputError",
    "LevelSchedule",
    "LossWeights",
    "Mesh",
    "Outcome",
    "PointCloud",
    "Progress",
    "Reconstruction",
    "ReconstructionConfig",
    "ResourceError",
    "SolveError",
    "Stopped",
    "VisCoError",
    "evaluate",
    "read_mesh",
    "read_points",
    "reconstruct",
    "render_preview",
    "sniff_points",
    "write_mesh",
}


def test_all_is_what_the_package_promises() -> None:
    assert set(visco_core.__all__) == PROMISED
    assert visco_core.__all__ == sorted(visco_core.__all__)
    assert dir(visco_core) == visco_core.__all__


@pytest.mark.parametrize("name", sorted(PROMISED))
def test_every_public_name_resolves_to_what_it_is_called_and_says_what_it_is(name: str) -> None:
    found = getattr(visco_core, name)
    assert found.__name__ == name
    assert inspect.getdoc(found)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="reconstrukt"):
        _ = visco_core.reconstrukt


def test_the_submodules_shadow_no_public_name() -> None:
    """A module named like a function would replace it as soon as anyone imported the module."""
    code = (
        "import importlib, pkgutil, visco_core\n"
        "for found in pkgutil.iter_modules(visco_core.__path__):\n"
        "    importlib.import_module(f'visco_core.{found.name}')\n"
        "import types\n"
        "print([n for n in visco_core.__all__\n"
        "    if isinstance(getattr(visco_core, n), types.ModuleType)])\n"
    )
    assert in_a_fresh_process(code) == "[]"


@pytest.mark.parametrize(
    "line",
    [
        "import visco_core",
        "import visco_core.config",
        "import visco_core.errors, visco_core.progress, visco_core.result",
        "from visco_core import InputError, Budget, ReconstructionConfig, Mesh, Outcome",
        "import visco_core.cli",
        "import visco_core.kernels",
    ],
)
def test_importing_what_is_light_loads_nothing_heavy(line: str) -> None:
    code = f"import sys\n{line}\nprint(sorted(set({HEAVY!r}) & sys.modules.keys()))"
    assert in_a_fresh_process(code) == "[]"


def test_settings_do_not_even_need_numpy() -> None:
    code = "import sys, visco_core.config, visco_core.result\nprint('numpy' in sys.modules)"
    assert in_a_fresh_process(code) == "False"


def test_a_run_on_the_cpu_loads_neither_torch_nor_scipy(tmp_path: Path) -> None:
    """Importing them would take as long as the solve."""
    scan, mesh = Path(visco_core.__file__).parent / "samples" / "octopus.ply", tmp_path / "mesh.ply"
    command = ["reconstruct", str(scan), "-o", str(mesh), "--resolution", "64", "-q"]
    code = (
        "import sys\n"
        "from visco_core.cli import main\n"
        f"assert main({[*command, '--device', 'cpu']!r}) == 0\n"
        "print({'torch', 'scipy'} & sys.modules.keys())"
    )
    assert in_a_fresh_process(code) == "set()"
    assert mesh.exists()


def in_a_fresh_process(code: str) -> str:
    """What ``code`` prints in a new interpreter in which warnings are errors."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()
