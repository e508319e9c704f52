"""From a file in the hand to a job that runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from browserkit import canvas_with, pixels, settle, silhouette
from playwright.sync_api import BrowserContext, CDPSession, Page, Route, expect
from servicekit import sphere_scan, until
from workerkit import Service

OpenPage = Callable[[str], Page]
# Every mesh that the viewer showed, in order.
_RECORD_MESHES = """
  window.meshes = [];
  new MutationObserver(() => {
    const shown = document.querySelector("canvas[data-mesh]")?.dataset.mesh;
    if (shown && window.meshes.at(-1) !== shown) window.meshes.push(shown);
  }).observe(document, { subtree: true, childList: true, attributes: true });
"""


def test_a_visitor_sees_the_samples_surface_form_after_three_clicks(
    context: BrowserContext, open_page: OpenPage, worker: None
) -> None:
    context.add_init_script(_RECORD_MESHES)
    page = open_page("/new")
    page.get_by_role("button", name="Take the sample").click()
    page.get_by_role("button", name="128").click()
    page.get_by_role("button", name="Reconstruct").click()
    page.wait_for_url("**/jobs/*")
    canvas = canvas_with(page, "mesh.glb")
    expect(page.get_by_text("Done", exact=True)).to_be_visible()
    assert page.evaluate("window.meshes")[-2:] == ["level-64.glb", "mesh.glb"]

    picture = pixels(canvas)
    seen = silhouette(picture)
    assert 0.08 < seen.mean() < 0.6
    # A lit surface has many tones; a black or flat one has few.
    assert picture[seen].mean() > 60
    assert picture[seen].astype(int).sum(axis=1).std() > 60


def test_settings_are_checked_as_they_are_typed(open_page: OpenPage) -> None:
    page = open_page("/new")
    page.get_by_role("button", name="Take the sample").click()
    field = page.get_by_label("Resolution", exact=False).first
    field.fill("63")
    expect(page.get_by_text("Between 64 and 1024.", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Reconstruct")).to_be_disabled()
    field.fill("64")
    expect(page.get_by_role("button", name="Reconstruct")).to_be_enabled()


def test_a_new_job_takes_the_settings_of_an_earlier_one(open_page: OpenPage, finished: str) -> None:
    page = open_page(f"/new?like={finished}")
    expect(page.get_by_label("Resolution", exact=False).first).to_have_value("128")
    expect(page.get_by_label("Label")).to_have_value("")


def test_settings_that_were_chosen_first_stay_when_the_files_come(
    open_page: OpenPage, finished: str
) -> None:
    page = open_page(f"/new?like={finished}")
    field = page.get_by_label("Resolution", exact=False).first
    expect(field).to_have_value("128")
    page.get_by_label("Label").fill("after all")
    page.get_by_role("button", name="Take the sample").click()
    expect(page.get_by_role("button", name="Remove octopus.ply")).to_be_visible()
    expect(field).to_have_value("128")
    expect(page.get_by_label("Label")).to_have_value("after all")


def test_files_and_folders_are_dropped_on_any_page(open_page: OpenPage, tmp_path: Path) -> None:
    deep = tmp_path / "parts" / "left" / "deep"
    deep.mkdir(parents=True)
    for path in (tmp_path / "one.ply", tmp_path / "parts" / "two.xyz", deep / "three.PLY"):
        path.write_bytes(sphere_scan())
    (deep / "notes.pdf").write_bytes(b"%PDF")
    (deep / ".hidden").write_bytes(b"")
    page = open_page("/")
    drop(page, [tmp_path / "one.ply", tmp_path / "parts"])
    expect(page.get_by_role("heading", name="3 scans")).to_be_visible()
    expect(page.get_by_text("1 file is no scan and left out.")).to_be_visible()
    names = page.get_by_role("list", name="Chosen scans").locator("bdi").all_inner_texts()
    assert names == ["one.ply", "three.PLY", "two.xyz"]


def test_a_folder_of_many_scans_is_taken_whole(open_page: OpenPage, tmp_path: Path) -> None:
    # A browser lists a folder in pieces of a hundred.
    for number in range(230):
        (tmp_path / f"part {number}.xyz").write_bytes(b"0 0 0\n")
    page = open_page("/new")
    drop(page, [tmp_path])
    expect(page.get_by_role("heading", name="230 scans")).to_be_visible()
    names = page.get_by_role("list", name="Chosen scans").locator("bdi").all_inner_texts()
    assert names == [f"part {number}.xyz" for number in range(230)]


def test_a_drop_without_a_scan_says_so(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page("/")
    drop(page, [tmp_path])
    expect(page.get_by_text("There is no scan in it.")).to_be_visible()


def test_a_drag_that_goes_elsewhere_leaves_the_page_as_it_was(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page("/")
    session = page.context.new_cdp_session(page)
    dragged = {"items": [], "files": [str(tmp_path)], "dragOperationsMask": 1}
    _drag(session, "dragEnter", dragged)
    expect(page.get_by_text("Drop scans or folders to reconstruct them")).to_be_visible()
    _drag(session, "dragCancel", dragged)
    expect(page.get_by_text("Drop scans or folders to reconstruct them")).to_have_count(0)


def drop(page: Page, paths: list[Path]) -> None:
    """Drag files and folders from the file manager onto the page and let go."""
    session = page.context.new_cdp_session(page)
    dragged = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
    _drag(session, "dragEnter", dragged)
    expect(page.get_by_text("Drop scans or folders to reconstruct them")).to_be_visible()
    # The browser drops only where the page has said that it takes the files, and asks it
    # again and again while they hover.
    page.evaluate("() => addEventListener('dragover', () => { window.asked = true })")
    until(lambda: _drag(session, "dragOver", dragged) or page.evaluate("window.asked === true"))
    settle(page)
    _drag(session, "drop", dragged)
    expect(page.get_by_text("Drop scans or folders to reconstruct them")).to_have_count(0)


def _drag(session: CDPSession, step: str, dragged: dict[str, Any]) -> None:
    event = {"type": step, "x": 300, "y": 300, "data": dragged}
    session.send("Input.dispatchDragEvent", event)


def test_a_refused_file_says_why_and_the_others_go_on(
    open_page: OpenPage, service: Service, tmp_path: Path
) -> None:
    (tmp_path / "good.ply").write_bytes(sphere_scan())
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat ascii 1.0\nthis is not one\n")
    page = open_page("/new")
    page.locator("input[type=file][multiple]").set_input_files(
        [tmp_path / "good.ply", tmp_path / "bad.ply"]
    )
    page.get_by_role("button", name="Reconstruct 2 scans").click()
    uploads = page.locator("section").filter(has=page.get_by_role("heading", name="Uploads"))
    expect(uploads.get_by_role("link", name="Open")).to_have_count(1)
    expect(uploads.get_by_role("button", name="Try again")).to_have_count(1)
    assert uploads.locator(".error").inner_text() != ""
    expect(uploads).to_contain_text("1 of 2 submitted")
    # What needs a hand stands first.
    assert uploads.locator("li bdi").all_inner_texts() == ["bad.ply", "good.ply"]
    uploads.get_by_role("button", name="Clear").click()
    assert uploads.locator("li bdi").all_inner_texts() == ["bad.ply"]


def test_many_scans_are_submitted_in_their_order_and_leave_one_where_one_is(
    open_page: OpenPage, service: Service, tmp_path: Path
) -> None:
    names = [f"scan {number}.ply" for number in range(5)]
    for name in names:
        (tmp_path / name).write_bytes(sphere_scan())
    page = open_page("/new")
    page.locator("input[type=file][multiple]").set_input_files([tmp_path / name for name in names])
    page.get_by_role("button", name="Reconstruct 5 scans").click()
    expect(page.get_by_text("5 of 5 submitted")).to_be_visible()
    assert page.url.endswith("/new")
    jobs = service.api.get("/v1/jobs", params={"limit": 5}).json()["jobs"]
    places = [names.index(job["scan"]["name"]) for job in reversed(jobs)]
    # Two go at once, so that neighbors may change places.
    assert all(abs(place - at) <= 1 for at, place in enumerate(places))


def test_an_upload_goes_on_where_the_connection_was_lost(
    context: BrowserContext, open_page: OpenPage, service: Service, tmp_path: Path
) -> None:
    scan = sphere_scan(20_000)
    (tmp_path / "cut.ply").write_bytes(scan)
    offsets = _cut_pieces(context, pieces={2, 3})
    page = open_page("/new")
    page.locator("input[type=file][multiple]").set_input_files(tmp_path / "cut.ply")
    page.get_by_role("button", name="Reconstruct").click()
    page.wait_for_url("**/jobs/*")
    job = service.job(page.url.rsplit("/", 1)[1])
    assert job["scan"]["sha256"] == hashlib.sha256(scan).hexdigest()
    assert offsets[1] == offsets[2] > 0


def test_an_upload_goes_on_after_the_page_was_closed(
    context: BrowserContext, open_page: OpenPage, service: Service, tmp_path: Path
) -> None:
    scan = sphere_scan(20_000)
    (tmp_path / "closed.ply").write_bytes(scan)
    offsets = _cut_pieces(context, pieces=set(range(2, 1000)))
    page = open_page("/new")
    page.locator("input[type=file][multiple]").set_input_files(tmp_path / "closed.ply")
    page.get_by_role("button", name="Reconstruct").click()
    until(lambda: page.evaluate("1") and len(offsets) >= 2)
    page.close()

    context.unroute_all()
    offsets = _cut_pieces(context, pieces=set())
    page = open_page("/new")
    page.locator("input[type=file][multiple]").set_input_files(tmp_path / "closed.ply")
    page.get_by_role("button", name="Reconstruct").click()
    page.wait_for_url("**/jobs/*")
    assert offsets[0] > 0


def _cut_pieces(context: BrowserContext, pieces: set[int]) -> list[int]:
    """Abort these PATCH calls, counted from 1; gives the offsets that were tried."""
    offsets: list[int] = []

    def handle(route: Route) -> None:
        if route.request.method != "PATCH":
            route.continue_()
            return
        offsets.append(int(route.request.headers["upload-offset"]))
        if len(offsets) in pieces:
            route.abort("connectionreset")
        else:
            route.continue_()

    context.route("**/v1/uploads/*", handle)
    return offsets
