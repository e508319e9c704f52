"""Two jobs of one scan beside each other."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from browserkit import canvas_with, finish, overlap, pixels, settle, silhouette
from playwright.sync_api import BrowserContext, Page, Route, expect
from workerkit import Service

OpenPage = Callable[[str], Page]


@pytest.fixture(scope="module")
def coarse(service: Service, worker: None) -> str:
    return finish(service, label="coarse", resolution=64)


def test_cameras_are_linked_and_differences_listed(
    open_page: OpenPage, finished: str, coarse: str
) -> None:
    page = open_page(f"/compare?jobs={finished},{coarse}")
    canvases = page.locator('canvas[data-mesh="mesh.glb"]')
    expect(canvases).to_have_count(2)
    settle(page)
    before = [silhouette(pixels(canvases.nth(index))) for index in range(2)]
    assert overlap(*before) > 0.9
    canvases.first.focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    settle(page)
    after = [silhouette(pixels(canvases.nth(index))) for index in range(2)]
    assert overlap(before[1], after[1]) < 0.85
    assert overlap(*after) > 0.9

    row = page.get_by_role("row", name="Resolution 128 64", exact=True)
    expect(row).to_be_visible()
    expect(page.get_by_role("row", name="Profile")).to_have_count(0)
    page.get_by_label("Also those that are the same").check()
    expect(page.get_by_role("row", name="Profile fast fast")).to_be_visible()


def test_the_slider_lays_one_over_the_other(
    open_page: OpenPage, finished: str, coarse: str
) -> None:
    page = open_page(f"/compare?jobs={finished},{coarse}")
    expect(page.locator('canvas[data-mesh="mesh.glb"]')).to_have_count(2)
    page.get_by_role("button", name="Slider").click()
    first, second = (page.locator(".stage-cell").nth(index).bounding_box() for index in range(2))
    assert first == second
    page.get_by_label("Where reference ends").fill("0.25")
    expect(page.locator(".stage-cell").nth(1)).to_have_css("clip-path", "inset(0px 0px 0px 25%)")


def test_one_job_alone_asks_for_another_of_its_scan(
    open_page: OpenPage, finished: str, coarse: str
) -> None:
    page = open_page(f"/compare?jobs={finished}")
    expect(page.get_by_role("heading", name="Choose a second job")).to_be_visible()
    page.get_by_label("Add a job of this scan").select_option(coarse)
    expect(page.get_by_role("heading", name="Metrics")).to_be_visible()


def test_colors_mean_the_same_in_both_and_one_section_cuts_both(
    open_page: OpenPage, finished: str, coarse: str
) -> None:
    page = open_page(f"/compare?jobs={finished},{coarse}")
    canvases = page.locator('canvas[data-mesh="mesh.glb"]')
    expect(canvases).to_have_count(2)
    page.get_by_label("Surface shown as").select_option("error")
    ends = page.get_by_label("Colors end at")
    expect(ends).to_have_count(2)
    assert ends.first.input_value() == ends.last.input_value()
    ends.first.fill("0.07")
    ends.first.press("Enter")
    expect(ends.last).to_have_value("0.07")

    page.get_by_label("Surface shown as").select_option("shaded")
    settle(page)
    whole = [silhouette(pixels(canvases.nth(index))) for index in range(2)]
    page.get_by_role("button", name="Section").click()
    settle(page)
    cut = [silhouette(pixels(canvases.nth(index))) for index in range(2)]
    for before, after in zip(whole, cut, strict=True):
        assert after.sum() < 0.8 * before.sum()
    assert overlap(*cut) > 0.9


def test_a_scale_that_is_drawn_anew_leaves_what_is_being_typed(
    open_page: OpenPage, finished: str, coarse: str
) -> None:
    page = open_page(f"/compare?jobs={finished},{coarse}")
    page.get_by_label("Surface shown as").select_option("error")
    ends, sliders = page.get_by_label("Colors end at"), page.get_by_label("Upper end of the colors")
    expect(ends).to_have_count(2)
    ends.first.fill("0.07")
    before = ends.last.input_value()
    sliders.last.evaluate(
        """slider => {
            slider.value = 0.5;
            slider.dispatchEvent(new Event('input', { bubbles: true }));
        }"""
    )
    expect(ends.last).not_to_have_value(before)
    expect(ends.first).to_have_value("0.07")
    ends.first.press("Enter")
    expect(ends.last).to_have_value("0.07")


def test_a_viewer_that_comes_later_looks_where_the_first_looks(
    context: BrowserContext, open_page: OpenPage, finished: str, coarse: str
) -> None:
    held: list[Route] = []
    context.route(f"**/{coarse}/artifacts/*.glb", lambda route: held.append(route))
    page = open_page(f"/compare?jobs={finished},{coarse}")
    first = canvas_with(page, "mesh.glb")
    first.focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    settle(page)
    turned = silhouette(pixels(first))
    held[0].continue_()
    canvases = page.locator('canvas[data-mesh="mesh.glb"]')
    expect(canvases).to_have_count(2)
    settle(page)
    assert overlap(silhouette(pixels(canvases.first)), turned) > 0.99
    assert overlap(silhouette(pixels(canvases.last)), turned) > 0.9
