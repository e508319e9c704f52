"""The surface in three dimensions: lit, upright, steady, cut and measured."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from browserkit import canvas_with, overlap, pixels, settle, silhouette
from PIL import Image
from playwright.sync_api import Browser, BrowserContext, Page, Route, expect
from workerkit import Service

OpenPage = Callable[[str], Page]


def test_the_camera_stays_when_a_finer_mesh_comes(
    context: BrowserContext, open_page: OpenPage, finished: str
) -> None:
    held: list[Route] = []
    context.route("**/artifacts/mesh.glb", lambda route: held.append(route))
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "level-64.glb")
    first = silhouette(pixels(canvas))
    canvas.focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    settle(page)
    turned = silhouette(pixels(canvas))
    assert overlap(first, turned) < 0.85

    held[0].continue_()
    fine = silhouette(pixels(canvas_with(page, "mesh.glb")))
    assert overlap(turned, fine) > 0.93


def test_the_scan_stands_upright(open_page: OpenPage, finished: str) -> None:
    seen = silhouette(pixels(canvas_with(open_page(f"/jobs/{finished}"), "mesh.glb")))
    rows = np.flatnonzero(seen.any(axis=1))
    widths = seen[rows[0] : rows[-1]].sum(axis=1)
    head, arms = np.array_split(widths, 2)
    # The octopus has its narrow head above its spread arms.
    assert arms.max() > 1.5 * head.max()


def test_a_section_opens_the_surface(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    whole = silhouette(pixels(canvas)).sum()
    page.get_by_role("button", name="Section").click()
    settle(page)
    half = silhouette(pixels(canvas)).sum()
    assert half < 0.8 * whole
    page.get_by_label("Place of the section").fill("1")
    settle(page)
    assert silhouette(pixels(canvas)).sum() > 1.2 * half


def test_shadings_differ(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    pictures = {}
    for mode in ("shaded", "facets", "normals", "colors"):
        page.get_by_label("Surface shown as").select_option(mode)
        settle(page)
        pictures[mode] = pixels(canvas).astype(int)
    seen = silhouette(pictures["shaded"])
    shaded = pictures["shaded"][seen].mean(axis=0)
    assert np.ptp(shaded) < 20, "the plain surface is grey"
    colored = pictures["colors"][seen].mean(axis=0)
    assert colored[0] > colored[2] + 40, "the octopus is red"
    assert np.abs(pictures["normals"] - pictures["shaded"])[seen].mean() > 20
    assert np.abs(pictures["facets"] - pictures["shaded"])[seen].mean() > 0.5


def test_a_length_is_measured_in_scan_units(
    open_page: OpenPage, service: Service, finished: str
) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    rows, columns = np.nonzero(silhouette(pixels(canvas)))
    left, right = columns.argmin(), columns.argmax()
    page.get_by_role("button", name="Measure").click()
    for end, inward in ((left, 4), (right, -4)):
        canvas.click(position={"x": int(columns[end]) + inward, "y": int(rows[end])})
    text = page.get_by_text(re.compile(r"^[\d.]+ scan units$"))
    expect(text).to_be_visible()
    # The octopus spans about 122 mm; its arm tips are a little nearer or farther than that.
    assert 60 < float(text.inner_text().split()[0]) < 180


def test_a_picture_of_the_view_is_saved(open_page: OpenPage, finished: str, tmp_path: Path) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas_with(page, "mesh.glb")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save a picture").click()
    download.value.save_as(tmp_path / "view.png")
    assert download.value.suggested_filename == "octopus.png"
    assert silhouette(np.asarray(Image.open(tmp_path / "view.png").convert("RGB"))).mean() > 0.05


def test_without_webgl_there_is_a_picture(
    browser: Browser, service: Service, finished: str
) -> None:
    context = browser.new_context(base_url=str(service.api.base_url))
    context.add_init_script(
        """const original = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
          return kind.startsWith("webgl") ? null : original.call(this, kind, ...rest);
        };"""
    )
    page = context.new_page()
    page.goto(f"/jobs/{finished}")
    expect(page.get_by_text("This browser has no WebGL")).to_be_visible()
    picture = page.get_by_role("img", name="The surface of octopus.ply")
    expect(picture).to_be_visible()
    assert pixels(picture).std() > 20
    context.close()


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_the_first_look_shows_all_of_it_and_not_much_else(
    browser: Browser, service: Service, finished: str, size: tuple[int, int]
) -> None:
    context = browser.new_context(
        base_url=str(service.api.base_url), viewport={"width": size[0], "height": size[1]}
    )
    page = context.new_page()
    page.goto(f"/jobs/{finished}")
    seen = silhouette(pixels(canvas_with(page, "mesh.glb")))
    height, width = seen.shape
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    assert rows[0] > 0.01 * height
    assert rows[-1] < 0.99 * height
    assert columns[0] > 0.01 * width
    assert columns[-1] < 0.99 * width
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.85
    context.close()


def test_no_inside_shines_through_at_the_outline(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    page.get_by_label("Surface shown as").select_option("shaded")
    settle(page)
    red, _, blue = np.moveaxis(pixels(canvas).astype(int), 2, 0)
    assert (red - blue > 25).sum() < 10
    page.get_by_role("button", name="Section").click()
    settle(page)
    red, _, blue = np.moveaxis(pixels(canvas).astype(int), 2, 0)
    assert (red - blue > 25).sum() > 1000, "the inside has a color of its own"


def test_a_scan_that_lies_is_stood_upright_and_stays_so(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    upright = silhouette(pixels(canvas))
    page.get_by_label("Up in the view").select_option("-z")
    settle(page)
    over = silhouette(pixels(canvas))
    assert overlap(upright, over) < 0.7
    page.reload()
    canvas = canvas_with(page, "mesh.glb")
    assert overlap(silhouette(pixels(canvas)), over) > 0.99
    page.get_by_label("Up in the view").select_option("z")
    settle(page)
    assert overlap(silhouette(pixels(canvas)), upright) > 0.93


def test_the_axes_lead_to_the_sides(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    sides = {}
    for axis in ("+X", "−X", "+Y", "+Z"):
        page.get_by_role("button", name=f"Look from {axis}").click()
        settle(page)
        sides[axis] = silhouette(pixels(canvas))
    # From the opposite side one sees nearly the same outline, mirrored.
    assert overlap(sides["+X"], sides["−X"][:, ::-1]) > 0.75
    assert overlap(sides["+X"], sides["−X"]) < 0.7
    assert overlap(sides["+X"], sides["+Y"]) < 0.75
    assert overlap(sides["+X"], sides["+Z"]) < 0.5


def test_the_view_is_moved_and_centred_as_well_as_turned(
    open_page: OpenPage, finished: str
) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    _, before = np.nonzero(silhouette(pixels(canvas)))
    canvas.focus()
    for _ in range(3):
        page.keyboard.press("Shift+ArrowRight")
    settle(page)
    _, after = np.nonzero(silhouette(pixels(canvas)))
    assert after.mean() > before.mean() + 40

    page.keyboard.press("f")
    settle(page)
    seen = silhouette(pixels(canvas))
    rows, columns = np.nonzero(seen)
    tip = columns.argmin()
    canvas.dblclick(position={"x": int(columns[tip]) + 5, "y": int(rows[tip])})
    settle(page)
    _, columns = np.nonzero(silhouette(pixels(canvas)))
    assert abs(columns.min() - seen.shape[1] / 2) < 0.05 * seen.shape[1]


def test_a_saved_picture_tells_what_its_colors_and_lines_mean(
    open_page: OpenPage, finished: str, tmp_path: Path
) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    plain = _saved(page, tmp_path / "plain.png")
    page.get_by_label("Surface shown as").select_option("error")
    page.locator(".legend").wait_for()
    page.get_by_role("button", name="Measure").click()
    rows, columns = np.nonzero(silhouette(pixels(canvas)))
    for end in (rows.argmin(), columns.argmax()):
        canvas.click(position={"x": int(columns[end]) - 3, "y": int(rows[end]) + 6})
    expect(page.get_by_text(re.compile(r"^[\d.]+ scan units$"))).to_be_visible()
    told = _saved(page, tmp_path / "told.png")
    # The bar goes from viridis' violet to its yellow.
    bar = told[-37:-27, 16:236].astype(int).mean(axis=0)
    assert bar[2, 2] > bar[2, 1] + 40
    assert bar[-3, 0] > bar[-3, 2] + 100
    assert np.abs(plain[-37:-27, 16:236].astype(int) - plain[-37:-27, 16:17]).max() < 12
    # The line runs over the background beside the head.
    beside = ~silhouette(plain)
    assert (told[beside].max(axis=1) < 60).sum() > (plain[beside].max(axis=1) < 60).sum() + 50


def _saved(page: Page, path: Path) -> np.ndarray:
    with page.expect_download() as download:
        page.get_by_role("button", name="Save a picture").click()
    download.value.save_as(path)
    return np.asarray(Image.open(path).convert("RGB"))
