"""What runs for long is left as soon as a stop is asked for."""

from __future__ import annotations

import threading

import pytest

from visco_core.errors import Stopped
from visco_core.progress import attend, never


def test_what_is_attended_returns_what_it_would_or_fails_as_it_would() -> None:
    assert attend(lambda: 7, never) == 7
    with pytest.raises(ZeroDivisionError):
        attend(lambda: 1 // 0, never)


def test_a_stop_does_not_wait_for_what_is_attended() -> None:
    released = threading.Event()
    asked: list[int] = []

    def stop_at_the_third() -> None:
        asked.append(1)
        if len(asked) == 3:
            raise Stopped

    try:
        with pytest.raises(Stopped):
            attend(released.wait, stop_at_the_third)
        assert len(asked) == 3
    finally:
        released.set()
