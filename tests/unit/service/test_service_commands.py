"""What a person sees of the service's commands."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

import httpx
import pytest
from servicekit import sphere_scan, submit

from service.cli.common import parse_settings
from service.client import Client, Job
from visco_core.cli import main

COMMANDS = {found.name: found.value for found in entry_points(group="visco.commands")}


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_argument_is_explained(command: str) -> None:
    parser = argparse.ArgumentParser()
    import_module(COMMANDS[command]).add_arguments(parser)
    parsers = [parser]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            parsers += action.choices.values()
        else:
            assert action.help, action
    for sub in parsers[1:]:
        assert all(action.help for action in sub._actions)


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "part.ply"
    path.write_bytes(sphere_scan())
    return path


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str]:
    """The exit code of a command that does nothing but complain, and its one sentence."""
    status = main([str(word) for word in words])
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("visco: ")
    assert said.err.count("\n") == 1
    return status, said.err


def test_a_result_that_cannot_be_written_is_refused_before_anything_is_sent(
    api: httpx.Client, scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = ("--url", api.base_url)
    nowhere = tmp_path / "nowhere" / "mesh.glb"
    for output in (nowhere, tmp_path / "mesh.3ds"):
        assert refused(capsys, "submit", scan, "-o", output, *url)[0] == 2
        assert refused(capsys, "download", "some-id", "-o", output, *url)[0] == 2
    assert api.get("/v1/jobs").json()["jobs"] == []


def test_what_the_service_refuses_is_the_commands_sentence(
    api: httpx.Client, scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url = ("--url", api.base_url)
    assert refused(capsys, "submit", scan, "--set", "resolution=1", *url)[0] == 2
    assert refused(capsys, "cancel", "no-such-job", *url)[0] == 2
    assert refused(capsys, "jobs", "--url", "127.0.0.1:8000")[0] == 1


def refused_alone(*words: object, **environment: str) -> str:
    """The one sentence of a command in a process of its own: it sets the logging up."""
    done = subprocess.run(
        [sys.executable, "-m", "visco_core.cli", *map(str, words)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode in (1, 2)
    assert done.stderr.startswith("visco: ")
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


def test_who_stops_waiting_is_told_how_to_cancel(
    api: httpx.Client,
    scan: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Client, "wait", interrupted)
    assert main(["submit", str(scan), "--wait", "--url", str(api.base_url)]) == 130
    said = capsys.readouterr()
    assert f"visco cancel {said.out.strip()}" in said.err


@pytest.mark.parametrize("outcome", ["complete", "budget_exhausted"])
def test_a_result_that_is_not_what_was_asked_for_is_told(
    outcome: str,
    api: httpx.Client,
    scan: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def finished(client: Client, job_id: str) -> Job:
        told = {"code": outcome, "message": "The budget ended at 128.", "resolution": 128}
        return Job.of({**client.get(job_id).raw, "result": {"outcome": told, "notes": []}})

    monkeypatch.setattr(Client, "wait", finished)
    assert main(["submit", str(scan), "--wait", "--url", str(api.base_url)]) == 0
    expected = "" if outcome == "complete" else "visco: The budget ended at 128.\n"
    assert capsys.readouterr().err == expected


@pytest.mark.parametrize("command", ["serve", "api", "keys list"])
def test_a_folder_that_cannot_be_used_is_named(command: str, scan: Path) -> None:
    assert str(scan) in refused_alone(*command.split(), "--data-dir", scan / "data")


def test_a_database_that_does_not_answer_is_named() -> None:
    url = "postgresql://visco@127.0.0.1:9/visco"
    assert "VISCO_DATABASE_URL" in refused_alone("keys", "list", VISCO_DATABASE_URL=url)


def test_a_queue_that_no_job_ever_enters_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("visco.cpu.hihg", "visco.cuda.high"):
        status, said = refused(capsys, "worker", "--device", "cpu", "--queue", name)
        assert status == 2
        assert "visco.cpu.high" in said


def test_a_service_without_workers_is_not_started(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["serve", "--workers", "0"])
    assert ended.value.code == 2
    assert "at least 1" in capsys.readouterr().err


def test_the_data_folder_of_keys_may_stand_before_or_behind_the_action(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ["--data-dir", str(tmp_path)]
    assert main(["keys", "list", *folder]) == 0
    assert "no keys yet" in capsys.readouterr().err
    assert main(["keys", *folder, "create", "robot"]) == 0
    assert main(["keys", "list", *folder]) == 0
    assert "robot" in capsys.readouterr().out


def test_parameters_are_read_by_their_types(capsys: pytest.CaptureFixture[str]) -> None:
    pairs = [
        "resolution=128", "lambda_v=1e-5", "label=12", "outputs=mesh.ply", "epochs=5",
        "crop=0, 0,0,1,1,1.5", "trim=null", 'callback_url=https://a.example/?a=1,2',
    ]  # fmt: skip
    assert parse_settings(pairs) == {
        "resolution": 128,
        "lambda_v": 1e-5,
        "label": "12",
        "outputs": ["mesh.ply"],
        "epochs": [5],
        "crop": [0, 0, 0, 1, 1, 1.5],
        "trim": None,
        "callback_url": "https://a.example/?a=1,2",
    }
    assert parse_settings(['outputs=["mesh.ply"]']) == {"outputs": ["mesh.ply"]}
    assert main(["submit", "none.ply", "--set", "help"]) == 0
    listed = capsys.readouterr().out
    assert "lambda_v" in listed
    assert "callback_url" in listed


def test_jobs_are_listed_with_their_state_and_name(
    api: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    job_id = submit(api, label="part 7").json()["id"]
    assert main(["jobs", "--url", str(api.base_url)]) == 0
    assert capsys.readouterr().out.split() == [job_id, "queued", "part", "7"]
    assert main(["cancel", job_id, "--url", str(api.base_url)]) == 0
    assert main(["jobs", "--status", "queued", "--url", str(api.base_url)]) == 0
    assert capsys.readouterr().out == ""
