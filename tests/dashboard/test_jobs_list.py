"""The list of jobs: live, long, searchable, and forgiving."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, Route, expect
from servicekit import add_job, make_settings, open_database, running_api, submit, until

from service.db import Database
from service.settings import Settings

MANY = 2000


@pytest.fixture
def quiet(tmp_path: Path) -> Settings:
    """Settings of a service without worker and broker: its jobs stay queued."""
    return make_settings(tmp_path, rate_limit_per_minute=0)


@pytest.fixture
def database(quiet: Settings) -> Iterator[Database]:
    opened = open_database(quiet)
    yield opened
    opened.dispose()


@pytest.fixture
def api(quiet: Settings, build: Path) -> Iterator[httpx.Client]:
    with running_api(quiet, build) as client:
        yield client


@pytest.fixture
def page(browser: Browser, api: httpx.Client) -> Iterator[Page]:
    context = browser.new_context(base_url=str(api.base_url))
    opened = context.new_page()
    opened.set_default_timeout(30_000)
    yield opened
    context.close()


def names(page: Page) -> list[str]:
    return page.locator(".job-body .name").all_inner_texts()


def test_an_empty_list_offers_the_first_scan(page: Page) -> None:
    page.goto("/")
    expect(page.get_by_role("button", name="Choose files")).to_be_visible()
    expect(page.get_by_role("button", name="Take the sample")).to_be_visible()
    expect(page.get_by_text("No worker is running")).to_be_visible()


def test_a_job_that_is_submitted_elsewhere_appears_by_itself(
    page: Page, database: Database, api: httpx.Client
) -> None:
    add_job(database, label="first")
    page.goto("/")
    expect(page.get_by_text("1st in the queue")).to_be_visible()
    submit(api, label="second")
    expect(page.get_by_text("2nd in the queue")).to_be_visible()
    assert names(page) == ["second", "first"]


def test_thousands_of_jobs_are_few_rows_and_all_within_reach(
    page: Page, database: Database
) -> None:
    for number in range(MANY):
        add_job(database, label=f"part {number:04}", status="succeeded")
    page.goto("/")
    rows = page.locator(".job-body [role=row]")
    expect(page.get_by_role("table", name="Jobs")).to_have_attribute("aria-rowcount", str(MANY + 1))
    assert rows.count() < 60
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    expect(page.get_by_role("link", name="part 0000")).to_be_visible()
    assert rows.count() < 60
    page.get_by_role("searchbox").fill("part 1234")
    expect(page.get_by_role("link", name="part 1234")).to_be_visible()
    assert names(page) == ["part 1234"]


def test_the_list_filters_by_state_and_sorts_by_name(page: Page, database: Database) -> None:
    add_job(database, label="b", status="succeeded")
    add_job(database, label="a", status="failed", error_code="x", error_detail="Use fewer points.")
    add_job(database, label="c", status="succeeded")
    page.goto("/")
    expect(page.get_by_text("Use fewer points.")).to_be_visible()
    page.get_by_role("button", name="Name").click()
    assert names(page) == ["a", "b", "c"]
    page.get_by_role("button", name="Done 2").click()
    assert names(page) == ["b", "c"]


def test_a_phone_sorts_and_marks_as_well(page: Page, database: Database) -> None:
    for label in ("b", "a"):
        add_job(database, label=label, status="succeeded")
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto("/")
    expect(page.get_by_role("link", name="a", exact=True)).to_be_visible()
    page.get_by_role("button", name="Name").click()
    assert names(page) == ["a", "b"]
    page.get_by_role("button", name="Name").click()
    assert names(page) == ["b", "a"]
    page.get_by_role("checkbox", name="Select all shown jobs").check()
    expect(page.get_by_text("2 selected")).to_be_visible()


def test_a_bulk_delete_can_be_taken_back_and_else_happens(
    page: Page, database: Database, api: httpx.Client
) -> None:
    for label in ("keep", "drop one", "drop two"):
        add_job(database, label=label, status="succeeded")
    page.goto("/")
    for label in ("drop one", "drop two"):
        page.get_by_role("checkbox", name=f"Select {label}").check()
    page.get_by_role("button", name="Delete").click()
    expect(page.get_by_role("link", name="drop one")).to_have_count(0)
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("link", name="drop one")).to_be_visible()
    assert len(api.get("/v1/jobs").json()["jobs"]) == 3

    for label in ("drop one", "drop two"):
        page.get_by_role("checkbox", name=f"Select {label}").check()
    page.get_by_role("button", name="Delete").click()
    until(lambda: page.evaluate("1") and len(api.get("/v1/jobs").json()["jobs"]) == 1)
    assert names(page) == ["keep"]


def test_a_bulk_delete_waits_when_the_server_is_crowded(
    page: Page, database: Database, api: httpx.Client
) -> None:
    for label in ("one", "two"):
        add_job(database, label=label, status="succeeded")
    refused: list[str] = []

    def handle(route: Route) -> None:
        if route.request.method != "DELETE" or refused:
            route.continue_()
            return
        refused.append(route.request.url)
        body = '{"code": "rate_limited", "detail": "Wait a second.", "status": 429}'
        route.fulfill(status=429, body=body, headers={"Retry-After": "1"})

    page.route("**/v1/jobs/*", handle)
    page.goto("/")
    page.get_by_role("checkbox", name="Select all shown jobs").check()
    page.get_by_role("button", name="Delete").click()
    until(lambda: page.evaluate("1") and api.get("/v1/jobs").json()["jobs"] == [])
    assert len(refused) == 1


def test_leaving_the_page_does_not_lose_a_delete(
    page: Page, database: Database, api: httpx.Client
) -> None:
    add_job(database, label="gone", status="succeeded")
    page.goto("/")
    page.get_by_role("checkbox", name="Select gone").check()
    page.get_by_role("button", name="Delete").click()
    page.goto("about:blank")
    until(lambda: api.get("/v1/jobs").json()["jobs"] == [])


def test_marked_jobs_are_cancelled_together(
    page: Page, database: Database, api: httpx.Client
) -> None:
    for label in ("one", "two"):
        add_job(database, label=label)
    page.goto("/")
    page.get_by_role("checkbox", name="Select all shown jobs").check()
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator(".badge.cancelled")).to_have_count(2)
    assert {job["status"] for job in api.get("/v1/jobs").json()["jobs"]} == {"cancelled"}
