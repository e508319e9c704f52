"""The scan beside its surface, and the surface colored by what is known of it."""

from __future__ import annotations

import hashlib
import io
import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from browserkit import canvas_with, finish, overlap, pixels, settle, silhouette
from playwright.sync_api import BrowserContext, Page, Route, expect
from workerkit import Service

from visco_core import Mesh, read_mesh, read_points
from visco_core.gallery import sample_scan_path, write_scan
from visco_core.io.glb import write_glb

OpenPage = Callable[[str], Page]
_COUNT_LEGENDS_GONE = """
  window.legendsGone = 0;
  new MutationObserver(() => {
    window.legendsGone += document.querySelector("figure.legend") ? 0 : 1;
  }).observe(document, { subtree: true, childList: true });
"""


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


def test_each_place_shows_its_confidence(
    context: BrowserContext, open_page: OpenPage, service: Service, finished: str
) -> None:
    mesh = _mesh_of(service, finished)
    below = (mesh.vertices[:, 2] < np.median(mesh.vertices[:, 2])).astype(np.float32)
    _serve_instead(context, finished, replace(mesh, attributes={"confidence": below}))
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    page.get_by_label("Surface shown as").select_option("confidence")
    legend = page.get_by_role("figure").filter(has_text="Confidence")
    expect(legend).to_contain_text("1: the scan supports it well")
    settle(page)
    picture = pixels(canvas)
    seen = silhouette(picture)
    rows = np.flatnonzero(seen.any(axis=1))
    head, arms = np.array_split(rows, 2)
    # Viridis is yellow at one and violet at zero.
    red, _, blue = picture[arms[-40:]][seen[arms[-40:]]].mean(axis=0)
    assert red > blue + 50
    red, _, blue = picture[head[:80]][seen[head[:80]]].mean(axis=0)
    assert blue > red


def test_a_hole_in_a_scan_is_seen_in_the_colors_of_confidence(
    open_page: OpenPage, service: Service, worker: None, tmp_path: Path
) -> None:
    cloud = read_points(sample_scan_path())
    # On the side of the head that the first look shows.
    hole = cloud.points[cloud.points[:, 2].argmax()] - [0, 12, 6]
    away = np.linalg.norm(cloud.points - hole, axis=1) > 14
    job_id = finish(service, write_scan(cloud.select(away), tmp_path / "hole.ply"), resolution=128)
    page = open_page(f"/jobs/{job_id}")
    canvas = canvas_with(page, "mesh.glb")
    page.get_by_label("Surface shown as").select_option("confidence")
    legend = page.get_by_role("figure").filter(has_text="Confidence")
    expect(legend).to_contain_text(re.compile(r"Under 0\.5\s*\d+ %"))
    settle(page)
    picture = pixels(canvas).astype(int)
    seen = silhouette(picture)
    red, green, blue = np.moveaxis(picture, 2, 0)
    # Viridis is yellow at one and violet, with next to no green, at zero.
    held = seen & (red > blue + 60) & (green > blue + 60)
    made_up = seen & (blue > green + 20)
    assert held.sum() > 0.6 * seen.sum()
    assert 0.03 * seen.sum() < made_up.sum() < 0.2 * seen.sum()
    rows = np.flatnonzero(seen.any(axis=1))
    head = slice(rows[0], rows[0] + len(rows) // 3)
    assert made_up[head].sum() > 0.9 * made_up.sum()


def test_a_surface_without_confidence_says_how_to_have_it(
    context: BrowserContext, open_page: OpenPage, service: Service, finished: str
) -> None:
    _serve_instead(context, finished, replace(_mesh_of(service, finished), attributes={}))
    page = open_page(f"/jobs/{finished}")
    canvas = canvas_with(page, "mesh.glb")
    page.get_by_label("Surface shown as").select_option("confidence")
    expect(
        page.get_by_text("This surface carries no confidence. Run the job again")
    ).to_be_visible()
    settle(page)
    # It stays in sight, in grey.
    assert np.ptp(_mean_color(pixels(canvas))) < 20


def test_distances_stay_on_show_until_those_of_the_finer_mesh_are_there(
    context: BrowserContext, open_page: OpenPage, finished: str
) -> None:
    coarse = True

    def job(route: Route) -> None:
        answer = route.fetch()
        found = answer.json()
        if coarse:
            found["artifacts"] = [one for one in found["artifacts"] if one["name"] != "mesh.glb"]
        route.fulfill(response=answer, json=found)

    context.route(f"**/v1/jobs/{finished}", job)
    page = open_page(f"/jobs/{finished}")
    canvas_with(page, "level-64.glb")
    page.get_by_label("Surface shown as").select_option("error")
    legend = page.locator("figure.legend")
    first = legend.inner_text()
    page.evaluate(_COUNT_LEGENDS_GONE)
    coarse = False
    context.set_offline(True)
    expect(page.get_by_text("The server cannot be reached.")).to_be_visible()
    context.set_offline(False)
    canvas_with(page, "mesh.glb")
    assert legend.inner_text() != first
    assert page.evaluate("window.legendsGone") == 0


def _mesh_of(service: Service, job_id: str) -> Mesh:
    ply = service.api.get(f"/v1/jobs/{job_id}/artifacts/mesh.ply").content
    with tempfile.NamedTemporaryFile(suffix=".ply") as file:
        file.write(ply)
        file.flush()
        return read_mesh(file.name)


def _serve_instead(context: BrowserContext, job_id: str, mesh: Mesh) -> None:
    """Let the job's finished mesh be another one."""
    file = io.BytesIO()
    write_glb(mesh, file)
    body = file.getvalue()

    def job(route: Route) -> None:
        answer = route.fetch()
        found = answer.json()
        for artifact in found["artifacts"]:
            if artifact["name"] == "mesh.glb":
                artifact |= {"size": len(body), "sha256": hashlib.sha256(body).hexdigest()}
        route.fulfill(response=answer, json=found)

    context.route(f"**/v1/jobs/{job_id}", job)
    context.route("**/artifacts/mesh.glb", lambda route: route.fulfill(body=body))
