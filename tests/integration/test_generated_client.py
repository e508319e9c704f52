"""A Python client made from the API's description works against the running service."""

from __future__ import annotations

import importlib
import io
import subprocess
import sys
from pathlib import Path

import pytest
from servicekit import make_settings, running_api, sphere_scan

from service.openapi import FILE

_CONFIG = """
package_name_override: made_client
post_hooks: []
content_type_overrides: {application/offset+octet-stream: application/octet-stream}
"""


@pytest.fixture
def generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The package name of a client that openapi-python-client has made."""
    (tmp_path / "config.yml").write_text(_CONFIG)
    program = str(Path(sys.executable).with_name("openapi-python-client"))
    made = subprocess.run(
        [
            program, "generate", "--path", FILE, "--meta", "none", "--output-path",
            tmp_path / "made_client", "--config", tmp_path / "config.yml", "--fail-on-warning",
        ],
        capture_output=True, text=True,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout + made.stderr
    monkeypatch.syspath_prepend(tmp_path)
    return "made_client"


def test_a_generated_client_submits_and_cancels(generated: str, tmp_path: Path) -> None:
    def part(name: str):
        return importlib.import_module(f"{generated}.{name}")

    with (
        running_api(make_settings(tmp_path)) as api,
        part("client").Client(base_url=str(api.base_url)) as client,
    ):
        options = part("api.service.list_options").sync(client=client)
        assert {"resolution", "lambda_v"} <= {option.name for option in options.options}
        submit = part("api.jobs.submit_job")
        body = part("models").SubmitJobBody(
            file=part("types").File(io.BytesIO(sphere_scan()), "part.ply"),
            params=part("models").JobParams(resolution=64, label="made"),
        )
        job = submit.sync(client=client, body=body)
        assert (job.label, job.status) == ("made", "queued")
        cancelled = part("api.jobs.cancel_job").sync(job.id, client=client)
        assert cancelled.status == "cancelled"
        missing = part("api.jobs.get_job").sync("nope", client=client)
        assert missing.code == "job_not_found"
