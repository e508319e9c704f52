"""Fixtures of the service's unit tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, open_database, running_api

from service.db import Database
from service.settings import Settings


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return make_settings(tmp_path)


@pytest.fixture
def database(settings: Settings) -> Iterator[Database]:
    opened = open_database(settings)
    yield opened
    opened.dispose()


@pytest.fixture
def api(settings: Settings) -> Iterator[httpx.Client]:
    """A running API without broker and workers: jobs stay queued."""
    with running_api(settings) as client:
        yield client
