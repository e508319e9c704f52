"""Which points of a scan stand at the same place."""

from __future__ import annotations

import numpy as np


def first_of_equals(points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """(K,) index of the first of each set of equal rows, rising, and (P,) each row's set.

    None where all rows differ. Rows are compared by a 64-bit key that is sorted; should two
    different rows share a key, at worst some duplicate stays.
    """
    keys = _row_keys(points)
    in_order = np.sort(keys)
    if not (in_order[1:] == in_order[:-1]).any():
        return None
    order = np.argsort(keys)
    in_order = keys[order]
    begins = np.ones(len(points), bool)
    begins[1:] = in_order[1:] != in_order[:-1]
    same_key = np.flatnonzero(~begins)
    begins[same_key] = (points[order[same_key]] != points[order[same_key - 1]]).any(axis=1)

    first = np.minimum.reduceat(order, np.flatnonzero(begins))
    by_place = np.argsort(first)
    place = np.empty_like(by_place)
    place[by_place] = np.arange(len(first))
    group = np.empty(len(points), np.int64)
    group[order] = place[np.cumsum(begins) - 1]
    return first[by_place], group


def _row_keys(points: np.ndarray) -> np.ndarray:
    """(P,) uint64: equal for equal rows (also for 0 and -0), else almost surely different."""
    bits = (points + 0.0).view(np.uint64)
    keys = bits[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    for axis, factor in ((1, 0xC2B2AE3D27D4EB4F), (2, 0x165667B19E3779F9)):
        keys ^= keys >> np.uint64(32)
        keys += bits[:, axis]
        keys *= np.uint64(factor)
    return keys ^ (keys >> np.uint64(29))
