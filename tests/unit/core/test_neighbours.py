"""Neighbours are the nearest, whatever the pieces they are looked up in, and a stop is heeded."""

from __future__ import annotations

import numpy as np
import pytest

from visco_core.errors import Stopped
from visco_core.neighbours import PIECE, Neighbours


@pytest.mark.parametrize("count", [1, 5])
def test_the_nearest_points_are_those_of_brute_force(count: int) -> None:
    rng = np.random.default_rng(0)
    points, places = rng.random((300, 3)), rng.random((40, 3))
    between = np.linalg.norm(places[:, None] - points, axis=2)
    distance, index = Neighbours(points).nearest(places, count)
    np.testing.assert_array_equal(index, np.argsort(between, 1)[:, :count])
    np.testing.assert_allclose(distance, np.sort(between, 1)[:, :count])


def test_what_is_farther_than_asked_is_infinitely_far() -> None:
    distance, _ = Neighbours(np.zeros((1, 3))).nearest(np.array([[0, 0, 1.0], [0, 0, 3]]), within=2)
    assert distance.tolist() == [[1.0], [np.inf]]


def test_a_stop_is_asked_for_before_every_piece() -> None:
    points = np.random.default_rng(1).random((PIECE, 3))
    asked: list[int] = []
    found = Neighbours(points, check=lambda: asked.append(1))
    asked.clear()
    found.nearest(points)
    assert len(asked) == 1
    found.nearest(np.append(points, points[:1], 0))
    assert len(asked) == 3


def test_a_stop_ends_the_search() -> None:
    wanted = False

    def check() -> None:
        if wanted:
            raise Stopped

    points = np.random.default_rng(1).random((100, 3))
    found = Neighbours(points, check=check)
    wanted = True
    with pytest.raises(Stopped):
        found.nearest(points)
