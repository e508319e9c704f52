"""The pictures of docs/dashboard.md, taken from a service that runs.

    python tests/dashboard/pictures.py http://127.0.0.1:8000 docs/images

Submits the sample a few times, so that there is something to see; an empty data folder gives the
pictures that are committed.
"""

from __future__ import annotations

import io
import json
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from visco_core import read_points
from visco_core.gallery import encode_scan, sample_scan_path

_FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking"]
_COLORS = 256
# Long enough for the viewer to load, draw and measure in software.
_SETTLE_SECONDS = 6
Act = Callable[[Page], None]


def main(url: str, folder: Path) -> None:
    client = httpx.Client(base_url=url, timeout=30)
    coarse = _finish(client, resolution=64, label="octopus, draft")
    fine = _finish(client, resolution=256, label="octopus, fine")
    _finish(client, crop=[900, 900, 900, 901, 901, 901], label="octopus, cropped away")
    with sync_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=path, args=_FLAGS)
        studio = _Studio(browser, url, folder)
        running = _submit(client, resolution=256, label="octopus, again")
        _submit(client, resolution=128, label="octopus, smoother", lambda_v=1e-4)
        studio.take("running", f"/jobs/{running}", seconds=5)
        for look in ("light", "dark", "phone"):
            studio.take("jobs", "/", look, seconds=2)
            studio.take("new", "/new", look, _choose_sample, seconds=2)
        studio.take("job", f"/jobs/{fine}", "light", _color_by_distance)
        studio.take("job", f"/jobs/{fine}", "dark", _cut)
        studio.take("job", f"/jobs/{fine}", "phone")
        for look in ("light", "dark", "phone"):
            studio.take("compare", f"/compare?jobs={coarse},{fine}", look)
        holed = _finish(client, _scan_with_a_hole(), resolution=256, label="octopus, with a hole")
        studio.take("confidence", f"/jobs/{holed}", "light", _color_by_confidence)
        browser.close()


class _Studio:
    def __init__(self, browser: Browser, url: str, folder: Path) -> None:
        self.browser = browser
        self.url = url
        self.folder = folder

    def take(
        self,
        name: str,
        path: str,
        look: str = "light",
        act: Act = lambda page: None,
        seconds: float = _SETTLE_SECONDS,
    ) -> None:
        phone = look == "phone"
        context = self.browser.new_context(
            base_url=self.url,
            color_scheme="dark" if look == "dark" else "light",
            viewport={"width": 390, "height": 844} if phone else {"width": 1280, "height": 800},
        )
        page = context.new_page()
        page.goto(path)
        page.wait_for_timeout(seconds * 1000)
        act(page)
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        target = self.folder / f"dashboard-{name}-{look}.png"
        picture.quantize(_COLORS, kmeans=2, dither=Image.Dither.NONE).save(target, optimize=True)
        context.close()


def _choose_sample(page: Page) -> None:
    page.get_by_role("button", name="Take the sample").click()
    page.get_by_role("button", name="Remove octopus.ply").wait_for()


def _color_by_distance(page: Page) -> None:
    page.get_by_label("Surface shown as").select_option("error")
    page.locator(".legend").wait_for()
    page.wait_for_timeout(1000)


def _color_by_confidence(page: Page) -> None:
    page.get_by_label("Surface shown as").select_option("confidence")
    page.wait_for_timeout(1000)


def _cut(page: Page) -> None:
    page.get_by_role("button", name="Section").click()
    page.wait_for_timeout(1000)


def _scan_with_a_hole() -> bytes:
    """The sample without a piece of its head."""
    cloud = read_points(sample_scan_path())
    hole = cloud.points[cloud.points[:, 2].argmax()] - [0, 12, 6]
    return encode_scan(cloud.select(np.linalg.norm(cloud.points - hole, axis=1) > 14))


def _submit(client: httpx.Client, scan: bytes | None = None, **params: object) -> str:
    files = {"file": (sample_scan_path().name, scan or sample_scan_path().read_bytes())}
    reply = client.post("/v1/jobs", files=files, data={"params": json.dumps(params)})
    return reply.raise_for_status().json()["id"]


def _finish(client: httpx.Client, scan: bytes | None = None, **params: object) -> str:
    job_id = _submit(client, scan, **params)
    while client.get(f"/v1/jobs/{job_id}").json()["status"] in ("queued", "running"):
        time.sleep(0.5)
    return job_id


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
