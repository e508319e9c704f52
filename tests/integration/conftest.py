"""A service of real processes: broker, API and workers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from servicekit import make_settings, running_api, running_broker
from workerkit import Service, Worker

from service.settings import Settings


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path, lease_seconds=4.0, heartbeat_seconds=0.5)


@pytest.fixture
def service(settings: Settings) -> Iterator[Service]:
    with running_broker(settings), running_api(settings) as client:
        yield Service(settings, client)


@pytest.fixture
def worker(service: Service) -> Iterator[Worker]:
    with service.worker() as started:
        yield started
