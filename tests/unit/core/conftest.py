"""The solver's backends and a run on a ball, as the tests of the core share them.

Torch gets one thread: on grids this small its threads would only wait for one another.
"""

from __future__ import annotations

import pytest
from runs import Record

from visco_core.gallery import sphere, uniform_scan
from visco_core.kernels import Backend, choose_backend
from visco_core.pointcloud import PointCloud

THREADS = {"native": 2, "reference": 1}


@pytest.fixture(scope="session")
def native_backend() -> Backend:
    return choose_backend("native", "cpu", THREADS["native"])


@pytest.fixture(scope="session")
def reference_backend() -> Backend:
    return choose_backend("reference", "cpu", THREADS["reference"])


@pytest.fixture(scope="session", params=THREADS)
def backend(request: pytest.FixtureRequest) -> Backend:
    """Each backend in turn."""
    return choose_backend(request.param, "cpu", THREADS[request.param])


@pytest.fixture(scope="session")
def ball() -> PointCloud:
    return uniform_scan(sphere(), 4000)


@pytest.fixture(scope="session")
def record(ball: PointCloud) -> Record:
    return Record.of(ball)
