"""What the dashboard's tests share: jobs of the sample scan, and looking at pixels."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import ConsoleMessage, Locator, Page
from servicekit import until
from workerkit import Service

from visco_core.gallery import sample_scan_path


class Watched:
    """A page whose errors are collected; a connection that is cut on purpose is none."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", self._hear)

    def _hear(self, message: ConsoleMessage) -> None:
        if message.type == "error" and "Failed to load resource" not in message.text:
            self.complaints.append(message.text)


def submit_sample(service: Service, **params: Any) -> str:
    return submit(service, sample_scan_path(), **params)


def submit(service: Service, scan: Path, **params: Any) -> str:
    reply = service.api.post(
        "/v1/jobs",
        files={"file": (scan.name, scan.read_bytes())},
        data={"params": json.dumps(params)},
    )
    return reply.raise_for_status().json()["id"]


def finish(service: Service, scan: Path | None = None, **params: Any) -> str:
    """The id of a job of the scan, or of the sample, that has succeeded."""
    job_id = submit(service, scan or sample_scan_path(), **params)

    def done() -> bool:
        job = service.job(job_id)
        assert job["status"] in ("queued", "running", "succeeded"), job["error"]
        return job["status"] == "succeeded"

    until(done, 180)
    return job_id


def pixels(element: Locator) -> np.ndarray:
    """What is seen of an element, without what lies over a canvas: (H, W, 3) uint8."""
    element.evaluate(_SHOW_LABELS, "hidden")
    png = element.screenshot()
    element.evaluate(_SHOW_LABELS, "")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


_SHOW_LABELS = """(element, visibility) => {
  if (element.tagName !== "CANVAS") return;
  const over = ".viewer-panel, .viewer-caption, .compass, .ruler, .stage-name";
  for (const one of document.querySelectorAll(over)) one.style.visibility = visibility;
}"""


def silhouette(picture: np.ndarray) -> np.ndarray:
    """(H, W) bool: where a picture of the stage differs from the grey behind it."""
    values = picture.astype(int)
    # The background has one color a row; beside its round corner its left edge shows which.
    edge = 12
    seen = np.abs(values - values[:, edge : edge + 1]).sum(axis=2) > 24
    seen[:, :edge] = seen[:, -edge:] = False
    return seen


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of two masks."""
    return float((a & b).sum() / (a | b).sum())


def canvas_with(page: Page, mesh: str) -> Locator:
    """The viewer's canvas, once it shows the mesh of that name and has drawn it."""
    canvas = page.locator(f'canvas[data-mesh="{mesh}"]')
    canvas.wait_for()
    settle(page)
    return canvas


def settle(page: Page) -> None:
    """Wait until two more frames have been drawn."""
    page.evaluate(
        "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
