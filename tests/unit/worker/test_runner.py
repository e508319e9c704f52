"""One attempt at a job, with every way that it can end."""

from __future__ import annotations

import hashlib
import json
import threading
import time
import weakref
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from servicekit import until

from service.auth.principal import LOCAL_USER
from service.db import utc_now
from service.jobs.model import Attempt
from service.jobs.reaper import Reaper
from service.jobs.service import JobService
from service.jobs.submission import JobIntake
from visco_core.errors import InputError, Stopped
from visco_core.pointcloud import PointCloud
from worker.lease import OBEY_SECONDS, POLL_SECONDS
from worker.solver import Hooks

if TYPE_CHECKING:
    from conftest import Bench, StandInSolver


def obey(hooks: Hooks) -> None:
    """What the core does between two steps, for as long as it takes."""
    deadline = time.monotonic() + 20
    pause = threading.Event()
    while not hooks.should_stop():
        assert time.monotonic() < deadline
        pause.wait(0.01)
    raise Stopped


def stored_files(bench: Bench) -> set[str]:
    """The keys below artifacts/ that have bytes."""
    storage = bench.settings.data_dir / "storage"
    files = (path for path in (storage / "artifacts").rglob("*") if path.is_file())
    return {str(path.relative_to(storage)) for path in files}


def test_a_finished_attempt_leaves_the_mesh_and_the_story(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit(resolution=64, up_axis="y")
    bench.runner(solver).run(job.id)
    done = bench.load(job)
    assert (done.status, done.attempt, done.error_code) == ("succeeded", 1, None)
    assert done.result is not None
    assert done.result["outcome"]["resolution"] == 64
    assert {phase["name"] for phase in done.result["phases"]} >= {"fetch", "read", "solve", "write"}
    artifacts = bench.artifacts(job)
    assert set(artifacts) == {
        "mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt", "level-32.glb",
        "level-64.glb", "scan.glb",
    }  # fmt: skip
    for artifact in artifacts.values():
        content = bench.content(artifact)
        assert artifact.sha256 == hashlib.sha256(content).hexdigest()
        assert artifact.size == len(content)
    assert bench.content(artifacts["mesh.ply"]) == b".ply y 1"
    assert json.loads(bench.content(artifacts["report.json"]))["backend"] == "none"


def test_events_tell_the_attempt_in_order_without_gap(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()
    bench.runner(solver).run(job.id)
    events = bench.events(job)
    assert [event.sequence for event in events] == list(range(1, len(events) + 1))
    types = [event.type for event in events]
    assert (types[:2], types[-1]) == (["queued", "started"], "succeeded")
    assert types.count("level") == 2
    told = [event.data["artifact"] for event in events if event.type == "artifact"]
    assert told == ["mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt"]
    (first, second) = [event.data for event in events if event.data.get("phase") == "solve"]
    assert (first["level"], second["level"]) == (1, 2)
    assert first["losses"] == {"point": 1.0}


def test_the_time_left_counts_the_writing_of_what_is_wanted(
    bench: Bench, solver: StandInSolver
) -> None:
    runner = bench.runner(solver)
    runner.write_seconds.update({"mesh.glb": 100.0, "preview.png": 50.0})
    job = bench.submit(outputs=["mesh.glb"])
    runner.run(job.id)
    told = [event.data for event in bench.events(job) if event.type == "progress"]
    left = {progress["phase"]: progress["remaining_seconds"] for progress in told}
    assert left == {"read": None, "solve": 102.0, "write": 100.0}
    assert runner.write_seconds["mesh.glb"] < 100.0


def test_the_scan_is_kept_for_viewers_without_what_cannot_be_drawn(
    bench: Bench, solver: StandInSolver
) -> None:
    solver.cloud = PointCloud(np.array([[0, 0, 0], [np.nan, 0, 0], [0, np.inf, 0]]))
    job = bench.submit(up_axis="y")
    bench.runner(solver).run(job.id)
    assert bench.content(bench.artifacts(job)["scan.glb"]) == b"1 points y"
    (noted,) = [event.data for event in bench.events(job) if event.type == "scan"]
    assert noted == {"artifact": "scan.glb", "points": 1}


def test_only_the_wanted_outputs_are_made(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit(outputs=["mesh.ply"])
    bench.runner(solver).run(job.id)
    final = {name for name in bench.artifacts(job) if not name.startswith(("level-", "scan"))}
    assert final == {"mesh.ply", "report.json", "log.txt"}


def test_a_job_that_another_worker_has_is_left_alone(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()
    bench.runner(solver).run(job.id)
    bench.runner(solver).run(job.id)
    assert len(solver.configs) == 1


def test_cancel_reaches_a_running_solve(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()

    def cancelled(hooks: Hooks) -> None:
        bench.change(lambda jobs: jobs.cancel(jobs.held(job.id, 1)))
        obey(hooks)

    solver.during = cancelled
    bench.runner(solver).run(job.id)
    assert bench.load(job).status == "cancelled"
    assert bench.events(job)[-1].type == "cancelled"


def test_a_solver_that_is_deep_in_a_long_step_does_not_delay_a_cancel(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit()

    def deaf(hooks: Hooks) -> None:
        bench.change(lambda jobs: jobs.cancel(jobs.held(job.id, 1)))
        until(lambda: bench.load(job).status == "cancelled")
        obey(hooks)

    solver.during = deaf
    bench.runner(solver).run(job.id)
    assert [event.type for event in bench.events(job)].count("cancelled") == 1
    for artifact in bench.artifacts(job).values():
        assert len(bench.content(artifact)) == artifact.size


def test_looking_and_obeying_fit_into_the_promised_second() -> None:
    assert POLL_SECONDS + OBEY_SECONDS <= 0.8


def test_a_worker_that_ends_gives_its_job_back(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()

    def released(hooks: Hooks) -> None:
        with bench.database.transaction() as unit:
            unit.session.get_one(Attempt, (job.id, 1)).release_requested = True
        obey(hooks)

    solver.during = released
    bench.runner(solver).run(job.id)
    back = bench.load(job)
    assert (back.status, back.lost_attempts, back.enqueued_at) == ("queued", 0, None)


def test_heartbeats_keep_the_lease_of_a_long_solve(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()

    def long(hooks: Hooks) -> None:
        first = bench.load(job).lease_expires_at
        deadline = time.monotonic() + 20
        while bench.load(job).lease_expires_at == first:
            assert time.monotonic() < deadline

    solver.during = long
    bench.runner(solver).run(job.id)
    assert bench.load(job).status == "succeeded"


def test_an_attempt_that_was_given_up_for_lost_stores_nothing(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit()
    reaper = Reaper(bench.database, bench.bell, bench.settings)

    def reaped(hooks: Hooks) -> None:
        if bench.load(job).attempt == 1 and bench.load(job).status == "running":
            assert reaper.lose(job.id, attempt=1)

    solver.during = reaped
    bench.runner(solver).run(job.id)
    lost = bench.load(job)
    assert (lost.status, lost.lost_attempts) == ("queued", 1)
    kept = bench.artifacts(job)
    assert stored_files(bench) == {artifact.key for artifact in kept.values()}
    assert "level-64.glb" not in kept
    bench.runner(solver.__class__()).run(job.id)
    again = bench.load(job)
    assert (again.status, again.attempt) == ("succeeded", 2)
    assert {artifact.attempt for artifact in bench.artifacts(job).values()} == {2}


def test_a_job_deleted_in_mid_solve_leaves_no_bytes(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()

    intake = JobIntake(bench.database, bench.bell, bench.settings)
    jobs = JobService(bench.database, bench.storage, bench.bell, intake)

    def deleted(hooks: Hooks) -> None:
        until(lambda: "scan.glb" in bench.artifacts(job))
        jobs.delete(LOCAL_USER, job.id)
        obey(hooks)

    solver.during = deleted
    bench.runner(solver).run(job.id)
    assert stored_files(bench) == set()


def test_a_refusal_of_the_core_becomes_the_jobs_error(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit()

    def refuse(hooks: Hooks) -> None:
        raise InputError("too_few_points", "Send at least 20 points.")

    solver.during = refuse
    bench.runner(solver).run(job.id)
    failed = bench.load(job)
    assert (failed.status, failed.error_code) == ("failed", "too_few_points")
    assert failed.error_detail == "Send at least 20 points."
    assert b"too_few_points" in bench.content(bench.artifacts(job)["log.txt"])


def test_an_unforeseen_error_says_nothing_of_the_inside(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit()

    def crash(hooks: Hooks) -> None:
        raise ZeroDivisionError("/home/secret/path")

    solver.during = crash
    bench.runner(solver).run(job.id)
    failed = bench.load(job)
    assert failed.error_code == "internal_error"
    assert "secret" not in (failed.error_detail or "")


def test_a_damaged_scan_fails_the_job_before_it_is_solved(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit()
    stored = bench.settings.data_dir / "storage" / str(bench.load(job).upload.key)
    stored.write_bytes(stored.read_bytes() + b"\n")
    bench.runner(solver).run(job.id)
    assert bench.load(job).error_code == "input_lost"
    assert solver.configs == []


def test_memory_that_does_not_suffice_fails_with_advice_and_once(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit(resolution=512)

    def exhausted(hooks: Hooks) -> None:
        raise MemoryError

    solver.during = exhausted
    bench.runner(solver).run(job.id)
    assert bench.load(job).error_code == "out_of_memory"
    assert len(solver.configs) == 1


@pytest.fixture
def device_memory(monkeypatch: pytest.MonkeyPatch) -> int:
    """Bytes that a GPU has for a solve: 3 free, 2 of torch's own that hold nothing any more."""
    gib = 2**30
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda: (3 * gib, 24 * gib))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda: 4 * gib)
    monkeypatch.setattr(torch.cuda, "memory_allocated", lambda: 2 * gib)
    return 5 * gib


class Tensor:
    """Something large that lives on the device."""


def test_a_gpu_out_of_memory_halves_the_resolution_once_and_says_so(
    bench: Bench, solver: StandInSolver, device_memory: int
) -> None:
    job = bench.submit(resolution=512)
    held: list[weakref.ref[Tensor]] = []

    def exhausted(hooks: Hooks) -> None:
        if len(solver.configs) > 1:
            assert held[0]() is None, "the first try's memory is still taken"
            return
        tensor = Tensor()
        held.append(weakref.ref(tensor))
        raise torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB.")

    solver.during = exhausted
    bench.runner(solver, device="cuda").run(job.id)
    done = bench.load(job)
    assert done.status == "succeeded", done.error_detail
    assert [config.resolution for config in solver.configs] == [512, 256]
    assert done.result is not None
    assert "256" in done.result["notes"][0]
    assert done.result["notes"][1:] == ["Odd scan."], "what the core has to say comes after"
    (said,) = [event.data for event in bench.events(job) if event.type == "degraded"]
    assert said["detail"] == done.result["notes"][0]


def test_a_gpu_that_runs_out_of_memory_twice_fails_the_job_with_advice(
    bench: Bench, solver: StandInSolver, device_memory: int
) -> None:
    job = bench.submit(resolution=512)

    def exhausted(hooks: Hooks) -> None:
        raise torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate 20.00 GiB.")

    solver.during = exhausted
    bench.runner(solver, device="cuda").run(job.id)
    assert bench.load(job).error_code == "out_of_memory"
    assert [config.resolution for config in solver.configs] == [512, 256]


def test_the_solve_gets_a_memory_limit_and_the_threads_of_the_settings(
    bench: Bench, solver: StandInSolver
) -> None:
    job = bench.submit(max_memory_bytes=10**9)
    bench.runner(solver).run(job.id)
    (config,) = solver.configs
    assert config.budget.memory_bytes == 10**9
    assert config.device == "cpu"


def test_a_solve_on_a_gpu_is_planned_for_what_the_device_has_left(
    bench: Bench, solver: StandInSolver, device_memory: int
) -> None:
    job = bench.submit()
    bench.runner(solver, device="cuda").run(job.id)
    (config,) = solver.configs
    assert config.device == "cuda"
    assert config.budget.memory_bytes is not None
    assert 0.8 * device_memory < config.budget.memory_bytes < 0.9 * device_memory


def test_the_queue_wait_is_not_charged_to_the_budget(bench: Bench, solver: StandInSolver) -> None:
    job = bench.submit(budget_seconds=2)
    starts: list[float] = []
    solver.during = lambda hooks: starts.append(hooks.started_at)
    before = time.monotonic()
    bench.runner(solver).run(job.id)
    assert before <= starts[0] <= time.monotonic()
    assert bench.load(job).started_at <= utc_now()  # type: ignore[operator]
