"""The compiled library: what it refuses, and threads that get in nobody's way."""

from __future__ import annotations

import multiprocessing
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from visco_core.kernels import native
from visco_core.kernels.native import library

COUNT = 1_000_000


def dot_of_ones(threads: int) -> float:
    native.set_threads(threads)
    ones = np.ones(COUNT, np.float32)
    return native.dot(ones, ones)


def test_every_function_of_the_header_is_in_the_library_with_its_parameters() -> None:
    declared = re.findall(rf"{library.PREFIX}(\w+)\(", library.HEADER.read_text(encoding="utf-8"))
    assert list(library.functions()) == declared
    assert len(library.dot.argtypes) == 3  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "values",
    [np.ones(4), np.ones(4, np.int32), np.ones((4, 2), np.float32)[:, 0]],
    ids=["double", "integer", "strided"],
)
def test_an_array_that_a_kernel_cannot_write_to_is_refused(values: np.ndarray) -> None:
    z = np.ones(4, np.float32)
    with pytest.raises(Exception, match=r"needs (float32|a contiguous array)"):
        native.cg_direction(values, z, 0.5)
    np.testing.assert_array_equal(values, 1)


def test_an_array_that_cannot_be_written_to_is_refused() -> None:
    values = np.ones(4, np.float32)
    values.setflags(write=False)
    with pytest.raises(Exception, match="can be written to"):
        native.cg_direction(values, np.ones(4, np.float32), 0.5)


def test_an_array_that_is_only_read_may_have_strides() -> None:
    strided = np.arange(12, dtype=np.float32).reshape(4, 3)[:, 1]
    assert native.dot(strided, np.ones(4, np.float32)) == strided.sum()


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_callers_on_several_threads_all_get_their_own_result(threads: int) -> None:
    with ThreadPoolExecutor(6) as pool:
        assert list(pool.map(dot_of_ones, 60 * [threads])) == 60 * [COUNT]


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_makes_threads_of_its_own() -> None:
    assert dot_of_ones(4) == COUNT
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(dot_of_ones, (4,)).get(timeout=30) == COUNT
