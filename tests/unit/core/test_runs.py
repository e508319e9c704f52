"""How a run ends, and what it tells until then."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from runs import Record, assert_one_closed_body, config

from visco_core import initial, neighbours
from visco_core.config import Budget
from visco_core.errors import ResourceError, Stopped
from visco_core.kernels import native
from visco_core.pointcloud import PointCloud
from visco_core.progress import Progress
from visco_core.reconstruction import reconstruct


def test_progress_goes_through_all_phases_and_never_falls(record: Record) -> None:
    fractions = [progress.fraction for progress in record.progress]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1
    phases = list(dict.fromkeys(progress.phase for progress in record.progress))
    assert phases[0] == "prepare"
    assert phases[-4:] == ["start", "solve", "refine", "extract"]
    elapsed = [progress.elapsed_seconds for progress in record.progress]
    assert elapsed == sorted(elapsed)


def test_every_level_but_the_last_is_shown_once_as_a_mesh_in_scan_units(record: Record) -> None:
    ((mesh, resolution),) = record.levels
    assert resolution == 64
    assert_one_closed_body(mesh)
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert np.abs(radius - 1).max() * 64 / record.result.report["frame"]["scale"] < 0.25


def test_the_report_is_json_and_says_what_was_done(record: Record) -> None:
    report = json.loads(json.dumps(record.result.report))
    assert report["settings"]["resolution"] == 128
    assert report["settings"]["schedule"]["outer_steps"] == [2]
    for weights in report["settings"]["weights"]:
        assert weights.keys() >= {"point", "normal", "viscosity", "coarea"}
    assert report["outcome"]["code"] == record.result.outcome.code == "complete"
    assert report["frame"]["center"] == pytest.approx([0, 0, 0], abs=0.01)
    assert report["seconds"] > 0
    assert report["peak_memory_bytes"] > 2**20
    (noise,) = (phase for phase in report["phases"] if phase["phase"] == "noise")
    assert noise.keys() >= {"position", "bending", "normal_radians"}
    last = report["phases"][-1]
    assert last["phase"] == "extract"
    assert last["vertices"] == len(record.result.mesh.vertices)
    assert last["triangles"] == len(record.result.mesh.faces)
    assert [phase["phase"] for phase in report["phases"]].count("solve") == 2
    assert len({step["resolution"] for step in report["steps"]}) == 2


def test_cleaning_is_told_in_the_report(ball: PointCloud) -> None:
    twice = PointCloud(np.repeat(ball.points, 2, 0), np.repeat(ball.normals, 2, 0))
    report = reconstruct(twice, config()).report
    assert any("4,000" in note for note in report["phases"][0]["notes"])


def test_a_budget_that_ran_before_the_start_is_too_short(ball: PointCloud) -> None:
    with pytest.raises(ResourceError) as caught:
        reconstruct(ball, config(budget=Budget(seconds=5)), started_at=time.monotonic() - 3600)
    assert caught.value.code == "budget_too_short"


def test_a_budget_too_short_for_the_finest_level_gives_a_coarser_one(ball: PointCloud) -> None:
    result = reconstruct(ball, config(1024, budget=Budget(seconds=1.5)))
    assert result.outcome.code == "budget_exhausted"
    assert 64 <= result.outcome.resolution < 1024
    assert f"{result.outcome.resolution} of 1024" in result.outcome.message
    assert_one_closed_body(result.mesh)


def test_a_memory_limit_is_refused_or_limits_the_resolution(ball: PointCloud) -> None:
    with pytest.raises(ResourceError) as caught:
        reconstruct(ball, config(budget=Budget(memory_bytes=10**8)))
    assert caught.value.code == "memory_too_small"
    result = reconstruct(ball, config(1024, budget=Budget(memory_bytes=3 * 10**8)))
    assert result.outcome.code == "memory_limited"
    assert 64 <= result.outcome.resolution < 1024


@pytest.mark.parametrize("call", [1, 2, 5, 30])
def test_a_stop_request_ends_the_run_at_once(call: int, ball: PointCloud) -> None:
    calls: list[int] = []

    def should_stop() -> bool:
        calls.append(1)
        return len(calls) >= call

    with pytest.raises(Stopped):
        reconstruct(ball, config(), should_stop=should_stop)
    assert len(calls) == call


def test_a_stop_is_asked_for_again_and_again_within_every_phase(ball: PointCloud) -> None:
    asked: dict[str, int] = {}
    phase = "begin"

    def told(progress: Progress) -> None:
        nonlocal phase
        phase = progress.phase

    def should_stop() -> bool:
        asked[phase] = asked.get(phase, 0) + 1
        return False

    cloud = PointCloud(ball.points, colors=np.zeros(ball.points.shape, np.uint8))
    options = config(normals="estimate", trim=1.0)
    reconstruct(cloud, options, on_progress=told, should_stop=should_stop)
    least = {"prepare": 6, "normals": 8, "noise": 4, "start": 7, "solve": 20, "extract": 6}
    assert {name: asked[name] for name in least if asked[name] < least[name]} == {}


def test_no_more_threads_are_used_than_asked_for(
    ball: PointCloud, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[int] = []

    def spied(function: Callable[..., Any]) -> Callable[..., Any]:
        def spy(threads: int) -> Any:
            used.append(threads)
            return function(threads)

        return spy

    places = (native, "set_threads"), (neighbours, "set_threads"), (initial, "ThreadPoolExecutor")
    for module, name in places:
        monkeypatch.setattr(module, name, spied(getattr(module, name)))
    colors = np.zeros(ball.points.shape, np.uint8)
    some = ball.normals.copy()
    some[:5] = 0
    for normals in (None, some):
        cloud = PointCloud(ball.points, normals, colors)
        reconstruct(cloud, config(64, threads=1, trim=1.0))
    assert len(used) > 10
    assert set(used) == {1}
