"""The API is what its description says."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, open_database, running_api, running_broker, submit
from workerkit import finish_job

from service.auth.service import KeyService
from service.openapi import FILE, text
from service.settings import Settings

CONFIG = Path(__file__).with_name("schemathesis.toml")
HOOKS = Path(__file__).with_name("schemathesis_hooks.py")
HELPERS = Path(__file__).parents[1]


def test_the_committed_description_is_the_codes() -> None:
    assert FILE.read_text() == text(), "run `make openapi`"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path, require_keys=True, rate_limit_per_minute=0, quota_queued=0)


@pytest.fixture
def api(settings: Settings, tmp_path: Path) -> Iterator[httpx.Client]:
    """The service with its dashboard and a key, and without a worker."""
    database = open_database(settings)
    key = KeyService(database).create("test", "ann", ["read", "write"]).secret
    database.dispose()
    dashboard = tmp_path / "dashboard"
    dashboard.mkdir()
    (dashboard / "index.html").write_text("<title>VisCo</title>")
    with running_broker(settings), running_api(settings, dashboard) as client:
        client.headers["Authorization"] = f"Bearer {key}"
        yield client


def check(api: httpx.Client, folder: Path, config: str, *choice: str) -> None:
    """Run all checks of schemathesis on the chosen paths."""
    (folder / "schemathesis.toml").write_text(CONFIG.read_text() + config)
    done = subprocess.run(
        [
            str(Path(sys.executable).with_name("schemathesis")),
            *("--config-file", str(folder / "schemathesis.toml"), "run"),
            f"{api.base_url}/openapi.json",
            *("--checks", "all", "--max-examples", "12", "--seed", "1", "--no-color", *choice),
            *("--header", f"Authorization:{api.headers['Authorization']}"),
        ],
        env={**os.environ, "SCHEMATHESIS_HOOKS": str(HOOKS), "PYTHONPATH": str(HELPERS)},
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


def test_schemathesis_finds_no_difference_between_api_and_description(
    api: httpx.Client, tmp_path: Path
) -> None:
    """But for the events of jobs that nobody finishes: their stream would not end either."""
    check(api, tmp_path, "", "--exclude-path-regex", "/events$")


def test_schemathesis_finds_no_difference_in_what_a_finished_job_gives(
    api: httpx.Client, settings: Settings, tmp_path: Path
) -> None:
    job_id = submit(api).json()["id"]
    finish_job(settings, job_id, tmp_path)
    known = f'\n[parameters]\njob_id = "{job_id}"\nname = "log.txt"\n'
    check(api, tmp_path, known, "--include-path-regex", "/events$|/artifacts")
