"""What the documents promise about codes and settings is what the code has."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from service.errors import CATALOGUE, JOB_FAILURES
from service.jobs.state import EventType
from service.settings import Settings

ROOT = Path(__file__).resolve().parents[3]
ERRORS = (ROOT / "docs/errors.md").read_text()
API = (ROOT / "docs/api.md").read_text()
OPERATIONS = (ROOT / "docs/operations.md").read_text()


def test_the_catalogue_of_refusals_is_documented_to_the_letter() -> None:
    rows = re.findall(r"^\| (\d{3}) \| `(\w+)` \| (.+?) \| .+ \|$", ERRORS, re.MULTILINE)
    assert rows == [(str(p.status), code, p.title) for code, p in CATALOGUE.items()]


def test_every_way_that_a_job_can_fail_is_documented() -> None:
    documented = set(re.findall(r"^\| `(\w+)` \|", ERRORS, re.MULTILINE))
    assert documented >= set(JOB_FAILURES) | core_codes()


def core_codes() -> set[str]:
    """Codes of the errors that the core raises while it reads and reconstructs."""
    elsewhere = ("metrics.py", "mesh.py", "output.py", "commands", "preview", "gallery")
    codes = set()
    for path in (ROOT / "visco_core").rglob("*.py"):
        if any(word in path.parts or word == path.name for word in elsewhere):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            name, first = getattr(node.func, "id", ""), node.args[0]
            errors = ("InputError", "ResourceError", "SolveError")
            if name in errors and isinstance(first, ast.Constant):
                codes.add(str(first.value))
    return codes


def test_every_code_that_the_service_raises_is_in_the_catalogue() -> None:
    raised = set()
    for path in (ROOT / "service").rglob("*.py"):
        raised |= set(re.findall(r"ServiceError\(\s*\"(\w+)\"", path.read_text()))
    assert raised
    assert raised <= set(CATALOGUE)


def test_every_event_is_documented() -> None:
    table = API.split("## Events")[1].split("## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == set(get_args(EventType))


def test_every_setting_is_documented() -> None:
    rows = re.findall(r"^\| `VISCO_(\w+)` \| (.*?) \| (.+) \|$", OPERATIONS, re.MULTILINE)
    described = {name.upper(): f.description for name, f in Settings.model_fields.items()}
    assert {name: text for name, _, text in rows} == described


def test_the_service_starts_without_torch_and_without_the_worker() -> None:
    code = (
        "import sys, service.main, service.cli.serve, service.cli.api\n"
        "heavy = {'torch', 'worker', 'trimesh'} & {m.split('.')[0] for m in sys.modules}\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("VISCO_PORT", "70000"),
        ("VISCO_REDIS_URL", "broker:6379"),
        ("VISCO_DATABASE_URL", "mysql://db/visco"),
        ("VISCO_STORAGE_URL", "/mnt/scans"),
    ],
)
def test_a_wrong_setting_stops_the_start_with_a_sentence(name: str, value: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "visco_core.cli", "api"],
        env={name: value, "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"visco: {name}: ")
    assert done.stderr.count("\n") == 1


def test_settings_reach_child_processes_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(
        port=1, trusted_hosts=("a", "b"), webhook_secret="whsec_x", require_keys=True
    )
    for name, value in settings.environment().items():
        monkeypatch.setenv(name, value)
    assert Settings() == settings
