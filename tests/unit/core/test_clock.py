"""The clock keeps the budget, the progress and the report's phases straight."""

from __future__ import annotations

import math
import subprocess
import sys
import time

import pytest

from visco_core.clock import LAST_FRACTION, Clock, peak_memory_bytes
from visco_core.errors import Stopped
from visco_core.progress import Progress


def now() -> float:
    return time.monotonic()


def test_budget_runs_from_the_moment_it_is_told_and_has_no_end_without_one() -> None:
    clock = Clock(now() - 10, budget_seconds=4)
    assert clock.elapsed_seconds >= 10
    assert clock.remaining_seconds <= -6
    assert Clock(now()).remaining_seconds == math.inf


def test_work_is_late_once_its_slice_is_over_and_never_without_one() -> None:
    clock = Clock(now())
    assert not clock.late()
    clock.start_slice(1000)
    assert not clock.late()
    clock.start_slice(-1)
    assert clock.late()
    clock.start_slice(math.inf)
    assert not clock.late()


def test_check_raises_stopped_when_the_caller_says_so() -> None:
    answers = iter([False, True])
    clock = Clock(now(), should_stop=lambda: next(answers))
    clock.check()
    with pytest.raises(Stopped):
        clock.check()
    Clock(now()).check()


def test_a_phase_is_reported_timed_and_may_carry_results() -> None:
    seen: list[Progress] = []
    clock = Clock(now(), on_progress=seen.append)
    with clock.phase("prepare", points=7) as entry:
        entry["notes"] = ["merged"]
        assert not clock.phases
    assert [progress.phase for progress in seen] == ["prepare"]
    (found,) = clock.phases
    assert found["phase"] == "prepare"
    assert (found["points"], found["notes"]) == (7, ["merged"])
    assert 0 <= found["seconds"] < clock.elapsed_seconds + 1e-3
    assert found["peak_memory_bytes"] > 2**20


@pytest.mark.parametrize(("answers", "ran"), [([True], False), ([False, True], True)])
def test_a_phase_asks_to_stop_before_and_after_its_work(answers: list[bool], ran: bool) -> None:
    clock, work = Clock(now(), should_stop=lambda: answers.pop(0)), []
    with pytest.raises(Stopped), clock.phase("start"):
        work.append(1)
    assert bool(work) == ran


def test_a_phase_that_fails_is_not_in_the_report() -> None:
    clock = Clock(now())
    with pytest.raises(ZeroDivisionError), clock.phase("solve"):
        _ = 1 / 0
    assert clock.phases == []


def test_fraction_never_falls_and_stays_within_one_whatever_is_expected() -> None:
    seen: list[Progress] = []
    clock = Clock(now() - 100, on_progress=seen.append)
    for more in (None, 100, 300, 0, 50, 0):
        if more is not None:
            clock.expect(more)
        clock.report("solve", level=1, losses={"point": 1.0})
    fractions = [progress.fraction for progress in seen]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0
    assert fractions[1] == pytest.approx(0.5, abs=0.01)
    assert fractions[2] == fractions[1]
    assert fractions[3] == LAST_FRACTION
    assert max(fractions) <= 1
    assert seen[0].remaining_seconds is None
    assert seen[1].remaining_seconds == pytest.approx(100, abs=1)
    assert all((p.remaining_seconds or 0) >= 0 for p in seen)
    assert seen[1].losses == {"point": 1.0}


def test_peak_memory_is_in_bytes_and_grows_with_what_is_held() -> None:
    before = peak_memory_bytes()
    held = bytearray(before + 2**25)
    held[::4096] = b"x" * len(held[::4096])
    assert peak_memory_bytes() >= before + 2**24


def test_peak_memory_is_not_that_of_the_program_that_started_this_one() -> None:
    held = b"x" * 2**28
    code = "from visco_core.clock import peak_memory_bytes as peak; print(peak())"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert int(found.stdout) < len(held)
