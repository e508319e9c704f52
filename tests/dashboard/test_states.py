"""What goes wrong around the page: it says so, and goes on by itself."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from browserkit import canvas_with, finish
from playwright.sync_api import Browser, BrowserContext, Page, expect
from servicekit import add_job, make_settings, open_database, running_api, submit
from workerkit import ENDLESS, Service

from service.auth.service import KeyService

OpenPage = Callable[[str], Page]
_AWAY = "The server cannot be reached."
_EXPIRED = "The files of this job have expired. Retry it to make them again."


def test_the_list_recovers_when_the_server_comes_back(
    browser: Browser, build: Path, tmp_path: Path
) -> None:
    settings = make_settings(tmp_path)
    database = open_database(settings)
    add_job(database, label="before")
    context = browser.new_context()
    page = context.new_page()
    with running_api(settings, build) as client:
        page.goto(str(client.base_url))
        expect(page.get_by_role("link", name="before")).to_be_visible()
    expect(page.get_by_text(_AWAY)).to_be_visible()
    add_job(database, label="meanwhile")
    with running_api(settings, build):
        expect(page.get_by_role("link", name="meanwhile")).to_be_visible()
        expect(page.get_by_text(_AWAY)).to_have_count(0)
        context.close()
    database.dispose()


def test_a_running_job_is_followed_again_after_the_network_was_away(
    context: BrowserContext, open_page: OpenPage, service: Service, worker: None
) -> None:
    job_id = submit(service.api, **ENDLESS).json()["id"]
    page = open_page(f"/jobs/{job_id}")
    expect(page.get_by_text("Solving at 64")).to_be_visible()
    context.set_offline(True)
    expect(page.get_by_text(_AWAY)).to_be_visible()
    service.cancel(job_id)
    context.set_offline(False)
    expect(page.get_by_text("The job was cancelled.")).to_be_visible()
    expect(page.get_by_text(_AWAY)).to_have_count(0)


def test_a_job_that_does_not_exist_is_no_dead_end(open_page: OpenPage) -> None:
    page = open_page("/jobs/01aaaaaaaaaaaaaaaaaaaaaaaa")
    expect(page.get_by_role("heading", name="This job cannot be shown")).to_be_visible()
    page.get_by_role("link", name="All jobs", exact=True).click()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()


def test_an_unknown_page_is_no_dead_end(open_page: OpenPage) -> None:
    page = open_page("/nothing/here")
    expect(page.get_by_role("link", name="All jobs", exact=True)).to_be_visible()


def test_expired_files_are_said_to_be_expired(
    open_page: OpenPage, service: Service, worker: None
) -> None:
    job_id = finish(service, resolution=64, label="expired")
    shutil.rmtree(service.settings.data_dir / "storage" / "artifacts" / job_id)
    page = open_page(f"/jobs/{job_id}")
    expect(page.locator(".viewer-caption")).to_have_text(_EXPIRED)
    page.get_by_role("link", name="mesh.ply").click()
    expect(page.locator(".toast")).to_have_text(_EXPIRED)
    assert page.url.endswith(job_id), "no page of raw JSON"
    # What happened is still known from the job's events.
    expect(page.get_by_label("Log", exact=True)).to_contain_text("Reached the full resolution")
    page.get_by_role("link", name="Retry with changes").click()
    page.get_by_role("button", name="Run again").click()
    page.wait_for_url(lambda url: "/jobs/" in url and job_id not in url)
    canvas_with(page, "mesh.glb")


def test_a_key_is_asked_for_and_stays_out_of_addresses_and_logs(
    browser: Browser, build: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = make_settings(tmp_path, require_keys=True)
    database = open_database(settings)
    secret = KeyService(database).create("test", "me", ["read", "write"]).secret
    add_job(database, owner="me", label="mine")
    caplog.set_level("INFO")
    context = browser.new_context()
    page = context.new_page()
    addresses: list[str] = []
    page.on("request", lambda request: addresses.append(request.url))
    with running_api(settings, build) as client:
        page.goto(str(client.base_url))
        dialog = page.get_by_role("dialog", name="API key")
        dialog.get_by_label("Key", exact=True).fill("visco_wrong")
        dialog.get_by_role("button", name="Use this key").click()
        expect(dialog.get_by_role("alert")).to_contain_text("visco keys create")
        dialog.get_by_label("Key", exact=True).fill(secret)
        dialog.get_by_role("button", name="Use this key").click()
        page.get_by_role("link", name="mine").click()
        expect(page.get_by_text("1st in the queue").first).to_be_visible()
        page.reload()
        expect(page.get_by_role("heading", name="mine")).to_be_visible()
        context.close()
    assert not any(secret in address for address in addresses)
    assert secret not in caplog.text
    database.dispose()
