"""One job: its life, its settings, and what can be done with it."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from browserkit import submit_sample
from playwright.sync_api import BrowserContext, Page, expect
from servicekit import submit
from workerkit import ENDLESS, Service

OpenPage = Callable[[str], Page]


def test_a_running_job_shows_its_steps_and_obeys_cancel(
    open_page: OpenPage, service: Service, worker: None
) -> None:
    job_id = submit(service.api, **ENDLESS).json()["id"]
    page = open_page(f"/jobs/{job_id}")
    expect(page.get_by_role("img", name="Loss terms over")).to_be_visible()
    expect(page.get_by_text("Solving at 64")).to_be_visible()
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_text("The job was cancelled.")).to_be_visible()
    assert service.job(job_id)["status"] == "cancelled"


def test_a_failed_job_says_what_to_do_and_offers_it(
    open_page: OpenPage, service: Service, worker: None
) -> None:
    # Everything lies outside of this box.
    job_id = submit_sample(service, crop=[900, 900, 900, 901, 901, 901])
    page = open_page(f"/jobs/{job_id}")
    notice = page.get_by_role("alert")
    expect(notice).to_contain_text("The job failed.")
    expect(notice).to_contain_text(service.job(job_id)["error"]["detail"])
    page.get_by_role("link", name="Retry with changes").click()
    page.get_by_text("Expert settings").click()
    expect(page.get_by_label("Crop", exact=False)).to_have_value("900 900 900 901 901 901")
    page.get_by_label("Crop", exact=False).fill("")
    page.get_by_label("Resolution", exact=False).first.fill("64")
    page.get_by_role("button", name="Run again").click()
    page.wait_for_url(lambda url: "/jobs/" in url and job_id not in url)
    params = service.job(page.url.rsplit("/", 1)[1])["params"]
    assert (params["crop"], params["resolution"]) == (None, 64)


def test_settings_are_copied_as_text(
    context: BrowserContext, open_page: OpenPage, finished: str
) -> None:
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = open_page(f"/jobs/{finished}")
    page.get_by_role("button", name="JSON").click()
    expect(page.get_by_text("Copied as JSON.")).to_be_visible()
    copied = json.loads(page.evaluate("navigator.clipboard.readText()"))
    assert copied == {"label": "reference", "resolution": 128}
    page.get_by_role("button", name="curl").click()
    expect(page.locator("pre.snippet")).to_contain_text('file=@"octopus.ply"')
    page.get_by_role("button", name="Python").click()
    expect(page.locator("pre.snippet")).to_contain_text("resolution=128")


def test_the_log_and_every_file_can_be_had(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    expect(page.get_by_label("Log", exact=True)).to_contain_text("Reached the full resolution")
    for name in ("mesh.glb", "mesh.ply", "preview.png", "report.json", "log.txt"):
        expect(page.get_by_role("link", name=name)).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("link", name="mesh.ply").click()
    assert download.value.suggested_filename == "mesh.ply"
    assert download.value.path().read_bytes()[:3] == b"ply"


@pytest.mark.parametrize("width", [1280, 390])
def test_long_names_and_those_of_any_direction_keep_their_place(
    context: BrowserContext, open_page: OpenPage, service: Service, width: int
) -> None:
    ids = []
    for name in ("y" * 190, "\u0645\u0633\u062d 12", "a\u202egpj"):
        reply = service.api.post(
            "/v1/jobs",
            files={"file": (f"{name}.xyz", b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n")},
            data={"params": json.dumps({"label": f"{name} {width}"})},
        )
        ids.append(reply.raise_for_status().json()["id"])
    for path in ("/", *(f"/jobs/{one}" for one in ids), f"/compare?jobs={','.join(ids)}"):
        page = open_page(path)
        page.set_viewport_size({"width": width, "height": 800})
        expect(page.locator("bdi").first).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= width, path
        # Nothing that somebody typed turns the text after it.
        assert "\u202e" not in page.locator("body").inner_text()
        page.close()


def test_a_job_that_ended_at_once_says_so_where_its_curves_would_be(
    open_page: OpenPage, service: Service, worker: None
) -> None:
    job_id = submit_sample(service, crop=[900, 900, 900, 901, 901, 901])
    page = open_page(f"/jobs/{job_id}")
    expect(page.get_by_text("The job ended before its first step.")).to_be_visible()
    # There is a scan to see, but no surface to choose a look for.
    expect(page.get_by_role("button", name="Section")).to_be_visible()
    expect(page.get_by_label("Surface shown as")).to_have_count(0)


def test_names_are_text_and_nothing_else(open_page: OpenPage, service: Service) -> None:
    hostile = "<img src=x onerror='window.hacked = 1'>"
    reply = service.api.post(
        "/v1/jobs",
        files={"file": (f"{hostile}.xyz", b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n")},
        data={"params": json.dumps({"label": hostile})},
    )
    job_id = reply.raise_for_status().json()["id"]
    for path in ("/", f"/jobs/{job_id}", f"/new?like={job_id}", f"/compare?jobs={job_id}"):
        page = open_page(path)
        page.wait_for_load_state("networkidle") if path == "/new" else page.wait_for_timeout(0)
        expect(page.locator("h1")).to_be_visible()
        assert page.evaluate("window.hacked") is None
        assert page.locator("img[src=x]").count() == 0
    page = open_page(f"/jobs/{job_id}")
    expect(page.get_by_role("heading", name=hostile)).to_be_visible()
