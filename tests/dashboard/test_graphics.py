"""Graphics that are slow, are taken away, or come back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from browserkit import canvas_with, overlap, pixels, settle, silhouette
from playwright.sync_api import BrowserContext, Locator, Page, expect
from servicekit import until

OpenPage = Callable[[str], Page]
# The canvas has one context, so this is the viewer's own.
_LOSE = """canvas => {
  window.graphics = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
  window.graphics.loseContext();
}"""
# A graphics card that needs the given time for each triangle, whatever machine runs the test.
_PACE = """
  const begun = new WeakMap();
  const fence = WebGL2RenderingContext.prototype.fenceSync;
  WebGL2RenderingContext.prototype.fenceSync = function (...given) {
    const sync = fence.apply(this, given);
    const drawn = Number(this.canvas.dataset.drawn);
    begun.set(sync, performance.now() + drawn * %s);
    return sync;
  };
  WebGL2RenderingContext.prototype.clientWaitSync = function (sync) {
    const done = performance.now() >= begun.get(sync);
    return done ? this.ALREADY_SIGNALED : this.TIMEOUT_EXPIRED;
  };
  // What a frame of the test's machine takes must not count.
  let clock = 0;
  const frame = window.requestAnimationFrame.bind(window);
  performance.now = () => clock;
  window.requestAnimationFrame = (act) => frame((time) => { clock += 4; act(time); });
"""


def test_graphics_that_come_back_show_the_same_view(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas, before = _turned(page)
    canvas.evaluate(_LOSE)
    expect(page.get_by_text("The browser took the graphics away")).to_be_visible()
    page.evaluate("window.graphics.restoreContext()")
    expect(page.get_by_text("The browser took the graphics away")).to_have_count(0)
    settle(page)
    assert overlap(silhouette(pixels(canvas)), before) > 0.99


def test_graphics_that_stay_away_are_asked_for_anew(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas, _ = _turned(page)
    page.get_by_label("Surface shown as").select_option("normals")
    settle(page)
    before = silhouette(pixels(canvas))
    canvas.evaluate("canvas => { canvas.dataset.old = 'yes' }")
    canvas.evaluate(_LOSE)
    expect(page.locator("canvas[data-old]")).to_have_count(0)
    settle(page)
    picture = pixels(canvas)
    assert overlap(silhouette(picture), before) > 0.99
    # It is colored as it was.
    assert picture[silhouette(picture)].astype(int).std(axis=1).mean() > 30


def test_graphics_that_are_lost_again_and_again_leave_a_picture(
    open_page: OpenPage, finished: str
) -> None:
    page = open_page(f"/jobs/{finished}")
    for _ in range(4):
        canvas = canvas_with(page, "mesh.glb")
        canvas.evaluate("canvas => { canvas.dataset.old = 'yes' }")
        canvas.evaluate(_LOSE)
        expect(page.locator("canvas[data-old]")).to_have_count(0)
    expect(page.get_by_role("img", name="The surface of octopus.ply")).to_be_visible()
    page.get_by_role("button", name="Try again").click()
    assert silhouette(pixels(canvas_with(page, "mesh.glb"))).mean() > 0.08


def test_slow_graphics_draw_less_while_the_view_turns_and_all_at_rest(
    context: BrowserContext, open_page: OpenPage, finished: str
) -> None:
    context.add_init_script(_PACE % "0.01")
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    triangles = int(canvas.get_attribute("data-triangles") or 0)
    _hold(page, canvas)
    until(lambda: _turn(page) and _drawn(canvas) < triangles / 3)
    reduced = silhouette(pixels(canvas))
    page.mouse.up()
    expect(canvas).to_have_attribute("data-drawn", str(triangles))
    whole = silhouette(pixels(canvas))
    assert 0.85 < overlap(reduced, whole) < 1


def test_fast_graphics_draw_everything_while_the_view_turns(
    context: BrowserContext, open_page: OpenPage, finished: str
) -> None:
    context.add_init_script(_PACE % "0")
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    _hold(page, canvas)
    for _ in range(20):
        _turn(page)
        assert str(_drawn(canvas)) == canvas.get_attribute("data-triangles")
    page.mouse.up()


def _turned(page: Page) -> tuple[Locator, np.ndarray]:
    """The canvas with the final mesh, turned, and its silhouette."""
    canvas = canvas_with(page, "mesh.glb")
    canvas.focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    settle(page)
    return canvas, silhouette(pixels(canvas))


def _hold(page: Page, canvas: Locator) -> None:
    box = canvas.bounding_box()
    assert box
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    canvas.focus()


def _turn(page: Page) -> bool:
    """Drag a little to and fro, and let it be drawn."""
    for step in (1, 0):
        page.mouse.move(640 + step, 450)
        settle(page)
    return True


def _drawn(canvas: Locator) -> int:
    return int(canvas.get_attribute("data-drawn") or 0)
