"""The API is what its description says."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from servicekit import make_settings, open_database, running_api, running_broker

from service.auth.service import KeyService
from service.openapi import FILE, text

CONFIG = Path(__file__).with_name("schemathesis.toml")
HOOKS = Path(__file__).with_name("schemathesis_hooks.py")


def test_the_committed_description_is_the_codes() -> None:
    assert FILE.read_text() == text(), "run `make openapi`"


def test_schemathesis_finds_no_difference_between_api_and_description(tmp_path: Path) -> None:
    """All of its checks but one: that what fits the schema is always accepted.

    A crop box whose corners are swapped, or a callback_url of a private host, fits the schema and
    is refused. The events are left out since their stream only ends with the job.
    """
    settings = make_settings(tmp_path, require_keys=True, rate_limit_per_minute=0, quota_queued=0)
    database = open_database(settings)
    key = KeyService(database).create("test", "ann", ["read", "write"]).secret
    database.dispose()
    dashboard = tmp_path / "dashboard"
    dashboard.mkdir()
    (dashboard / "index.html").write_text("<title>VisCo</title>")
    with running_broker(settings), running_api(settings, dashboard) as client:
        done = subprocess.run(
            [
                str(Path(sys.executable).with_name("schemathesis")),
                *("--config-file", str(CONFIG), "run"),
                f"{client.base_url}/openapi.json",
                *("--checks", "all", "--exclude-checks", "positive_data_acceptance"),
                *("--exclude-path-regex", "/events$", "--max-examples", "12", "--seed", "1"),
                *("--header", f"Authorization:Bearer {key}", "--no-color"),
            ],
            env={**os.environ, "SCHEMATHESIS_HOOKS": str(HOOKS)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
    assert done.returncode == 0, done.stdout[-6000:]
