"""The scan beside its surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from browserkit import canvas_with, overlap, pixels, settle, silhouette
from playwright.sync_api import Page, expect

OpenPage = Callable[[str], Page]


def test_the_scans_points_are_drawn_where_the_surface_is(
    open_page: OpenPage, finished: str
) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    surface = silhouette(pixels(canvas))
    page.get_by_role("button", name="Scan", exact=True).click()
    page.get_by_role("button", name="Surface", exact=True).click()
    settle(page)
    picture = pixels(canvas)
    points = silhouette(picture)
    # Alone they close up to a lit surface, a little fatter than the true one.
    assert overlap(points, surface) > 0.9
    assert (surface & ~points).sum() < 0.02 * surface.sum()
    assert picture[points].astype(int).sum(axis=1).std() > 60


def test_the_surface_is_colored_by_its_distance_to_the_scan(
    open_page: OpenPage, finished: str
) -> None:
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    red, _, blue = _mean_color(pixels(canvas).astype(int))
    assert red > blue + 10
    page.get_by_label("Surface shown as").select_option("error")
    legend = page.get_by_role("figure").filter(has_text="Distance to the scan")
    expect(legend).to_be_visible()
    expect(legend.get_by_role("img", name="Histogram: mean 0.")).to_be_visible()
    settle(page)
    picture = pixels(canvas).astype(int)
    # The octopus itself is red; small distances are viridis' violet and blue.
    red, _, blue = _mean_color(picture)
    assert blue > red + 10

    before = picture
    page.get_by_label("Upper end of the colors").fill("0.2")
    settle(page)
    assert np.abs(pixels(canvas).astype(int) - before).mean() > 1


def _mean_color(picture: np.ndarray) -> np.ndarray:
    return picture[silhouette(picture)].mean(axis=0)
