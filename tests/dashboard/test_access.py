"""For everyone: keyboard, screen readers, small screens; and little to load."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from browserkit import canvas_with, finish, submit_sample
from playwright.sync_api import Browser, BrowserContext, Page, expect
from servicekit import until
from workerkit import Service

OpenPage = Callable[[str], Page]
_AXE = Path(__file__).parents[2] / "service" / "dashboard" / "node_modules" / "axe-core" / "axe.js"
_LARGEST_FIRST_LOAD = 300_000


@pytest.fixture(params=["light", "dark", "phone"])
def look(request: pytest.FixtureRequest, browser: Browser, service: Service) -> Iterator[Page]:
    phone = request.param == "phone"
    context = browser.new_context(
        base_url=str(service.api.base_url),
        color_scheme="dark" if request.param == "dark" else "light",
        viewport={"width": 390, "height": 844} if phone else {"width": 1280, "height": 800},
        reduced_motion="reduce",
    )
    yield context.new_page()
    context.close()


def violations(page: Page) -> list[str]:
    """What axe calls serious or critical, one line each."""
    page.evaluate(_AXE.read_text())
    found = page.evaluate("axe.run(document, { resultTypes: ['violations'] })")["violations"]
    return [
        f"{one['id']}: {node['html']} {node['failureSummary']}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


@pytest.fixture(scope="module")
def twin(service: Service, worker: None) -> str:
    return finish(service, label="twin", resolution=64)


@pytest.fixture(scope="module")
def failed(service: Service, worker: None) -> str:
    job_id = submit_sample(service, crop=[900, 900, 900, 901, 901, 901])
    until(lambda: service.job(job_id)["status"] == "failed", 60)
    return job_id


def test_axe_finds_nothing_serious_on_any_page(
    look: Page, finished: str, twin: str, failed: str
) -> None:
    look.goto("/")
    expect(look.get_by_role("link", name="reference")).to_be_visible()
    look.get_by_role("checkbox", name="Select reference").check()
    assert violations(look) == []
    look.goto("/new")
    look.get_by_text("Expert settings").click()
    look.get_by_label("Resolution", exact=False).first.fill("1")
    assert violations(look) == []
    look.goto(f"/jobs/{finished}")
    canvas_with(look, "mesh.glb")
    look.get_by_role("button", name="Section").click()
    look.get_by_role("button", name="Measure").click()
    assert violations(look) == []
    look.get_by_label("Surface shown as").select_option("error")
    expect(look.locator("figure.legend")).to_be_visible()
    assert violations(look) == []
    look.goto(f"/compare?jobs={finished}")
    expect(look.get_by_role("heading", name="Choose a second job")).to_be_visible()
    assert violations(look) == []
    look.goto(f"/compare?jobs={finished},{twin}")
    expect(look.locator('canvas[data-mesh="mesh.glb"]')).to_have_count(2)
    assert violations(look) == []
    look.goto(f"/new?retry={failed}")
    expect(look.get_by_role("button", name="Run again")).to_be_enabled()
    assert violations(look) == []
    look.goto(f"/jobs/{failed}")
    expect(look.get_by_role("alert")).to_contain_text("The job failed.")
    assert violations(look) == []


def test_no_page_is_wider_than_the_screen(look: Page, finished: str) -> None:
    for path in ("/", "/new", f"/jobs/{finished}", f"/compare?jobs={finished},{finished}"):
        look.goto(path)
        expect(look.locator("h1")).to_be_visible()
        width = look.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert width[0] <= width[1], path


def test_the_sample_is_submitted_with_the_keyboard_alone(open_page: OpenPage, worker: None) -> None:
    page = open_page("/new")
    _tab_to(page, "No scan at hand? Take the sample")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Remove octopus.ply")).to_be_visible()
    _tab_to(page, "128")
    page.keyboard.press("Space")
    _tab_to(page, "Reconstruct")
    page.keyboard.press("Enter")
    page.wait_for_url("**/jobs/*")
    # The new page's heading has the focus, so that a screen reader says where one is.
    expect(page.locator("h1")).to_be_focused()


def _tab_to(page: Page, text: str) -> None:
    for _ in range(80):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent.trim()") == text:
            return
    pytest.fail(f"Tab never reaches {text!r}")


def test_little_is_loaded_before_there_is_something_to_look_at(open_page: OpenPage) -> None:
    page = open_page("/new")
    expect(page.get_by_label("Resolution", exact=False).first).to_be_visible()
    loaded = page.evaluate(
        """performance.getEntriesByType("resource").concat(
             performance.getEntriesByType("navigation")
           ).filter((one) => !one.name.includes("/v1/"))
            .map((one) => [one.name, one.transferSize])"""
    )
    assert sum(size for _, size in loaded) < _LARGEST_FIRST_LOAD
    assert not any("Viewer" in name for name, _ in loaded)


def test_what_is_built_for_the_first_load_is_small(build: Path) -> None:
    """The page, all that it names, and what those load at once; not what they import later."""
    page = (build / "index.html").read_text()
    found = re.findall(r'(?:src|href)="/(assets/[^"]+)"', page)
    for name in found:
        text = (build / name).read_text() if name.endswith((".js", ".css")) else ""
        at_once = re.findall(r'(?:from|^import|;import)\s*"\./([^"]+\.js)"', text)
        at_once += re.findall(r"url\(/assets/([^)]+)\)", text)
        found += [f"assets/{one}" for one in at_once if f"assets/{one}" not in found]
    assert not any("Viewer" in name for name in found)
    assert any(name.endswith(".woff2") for name in found)
    sizes = [len(gzip.compress((build / name).read_bytes())) for name in ["index.html", *found]]
    assert sum(sizes) < _LARGEST_FIRST_LOAD


def test_the_policy_lets_no_inline_script_run(context: BrowserContext) -> None:
    page = context.new_page()
    page.goto("/")
    page.evaluate(
        """() => {
          const script = document.createElement("script");
          script.textContent = "window.hacked = 1";
          document.body.append(script);
        }"""
    )
    assert page.evaluate("window.hacked") is None


def test_what_the_build_compressed_is_sent_so(service: Service) -> None:
    page = service.api.get("/", headers={"Accept-Encoding": "gzip"})
    assert page.headers["Content-Encoding"] == "gzip"
    assert page.headers["Content-Type"].startswith("text/html")
    plain = service.api.get("/", headers={"Accept-Encoding": "identity"})
    assert "Content-Encoding" not in plain.headers
    assert plain.text == page.text
