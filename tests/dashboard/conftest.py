"""A real service with a real worker, and a real browser in front of it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from browserkit import Watched, finish
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright
from servicekit import make_settings, running_api, running_broker
from workerkit import Service

from service.api.front_page import BUILD
from service.settings import Settings

# Software rendering beside a solver can be slow; a right page is never slower for it.
_PATIENCE = 60_000
expect.set_options(timeout=_PATIENCE)
_FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking"]


@pytest.fixture(scope="session")
def build() -> Path:
    """The built dashboard; `make` builds it before the tests."""
    assert (BUILD / "index.html").is_file(), "build the dashboard first: make dashboard"
    return BUILD


@pytest.fixture(scope="session")
def chromium() -> str:
    found = shutil.which("chromium") or shutil.which("google-chrome")
    assert found, "the dashboard's tests need a browser: apt install chromium"
    return found


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=chromium, args=_FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="session")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    # A browser that draws in software leaves little time for heartbeats.
    return make_settings(
        tmp_path_factory.mktemp("service"), lease_seconds=60.0, rate_limit_per_minute=0
    )


@pytest.fixture(scope="session")
def service(settings: Settings, build: Path) -> Iterator[Service]:
    with running_broker(settings), running_api(settings, build) as client:
        yield Service(settings, client)


@pytest.fixture(scope="session")
def worker(service: Service) -> Iterator[None]:
    with service.worker():
        yield


@pytest.fixture(scope="session")
def finished(service: Service, worker: None) -> str:
    """A job of the sample scan that has a level beside its mesh."""
    return finish(service, label="reference", resolution=128)


@pytest.fixture
def context(browser: Browser, service: Service) -> Iterator[BrowserContext]:
    opened = browser.new_context(
        base_url=str(service.api.base_url), viewport={"width": 1280, "height": 800}
    )
    opened.set_default_timeout(_PATIENCE)
    yield opened
    opened.close()


@pytest.fixture
def open_page(context: BrowserContext) -> Iterator[Callable[[str], Page]]:
    """Opens pages; afterwards none of them may have complained."""
    watched: list[Watched] = []

    def open_one(path: str) -> Page:
        one = Watched(context.new_page())
        watched.append(one)
        one.page.goto(path)
        return one.page

    yield open_one
    for one in watched:
        assert one.complaints == []
