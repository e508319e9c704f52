"""Who may import whom: the contracts in pyproject.toml hold, and they would notice a breach."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from importlinter import cli

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = ROOT / "pyproject.toml"
CONTRACTS = tomllib.loads(SETTINGS.read_text())["tool"]["importlinter"]["contracts"]

BREACHES = {
    "core-knows-no-service": ("visco_core/energy.py", "import fastapi"),
    "service-knows-no-solver": ("service/api/deps.py", "from visco_core.kernels import ROW"),
    "core-layers": ("visco_core/grid/samples.py", "from visco_core.level_plan import COARSEST"),
    "losses-are-the-specification": ("visco_core/losses.py", "import visco_core.kernels.reference"),
    "core-leaves": ("visco_core/config.py", "import numpy"),
}


def test_every_contract_is_kept() -> None:
    found = cli.lint_imports(config_filename=str(SETTINGS), no_cache=True)
    assert found == cli.EXIT_STATUS_SUCCESS


def test_every_contract_has_a_reason_beside_it() -> None:
    text = SETTINGS.read_text()
    assert len(CONTRACTS) == len(
        re.findall(r"\[\[tool\.importlinter\.contracts\]\]\n# [A-Z].+\.\nid = ", text)
    )
    assert {contract["id"] for contract in CONTRACTS} == BREACHES.keys()


@pytest.mark.parametrize("contract", BREACHES)
def test_a_contract_notices_a_breach(contract: str, tmp_path: Path) -> None:
    for package in ("visco_core", "service", "worker"):
        for source in (ROOT / package).rglob("*.py"):
            copy = tmp_path / source.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(source.read_bytes())
    place, line = BREACHES[contract]
    with (tmp_path / place).open("a") as file:
        file.write(f"\n\ndef breach():\n    {line}\n")
    command = ["-c", "from importlinter.cli import lint_imports_command as run; run()"]
    options = ["--config", str(SETTINGS), "--contract", contract, "--no-cache", "--no-logo"]
    done = subprocess.run(
        [sys.executable, *command, *options], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == cli.EXIT_STATUS_ERROR, done.stdout + done.stderr
    assert "BROKEN" in done.stdout
    broken = {name for name in done.stdout.splitlines() if "BROKEN" in name}
    assert len(broken) == 1
