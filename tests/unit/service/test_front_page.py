"""What a browser finds at the service's address."""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import pytest
from servicekit import make_settings, running_api


def test_without_a_dashboard_the_front_page_says_where_the_api_is(tmp_path: Path) -> None:
    with running_api(make_settings(tmp_path), dashboard=tmp_path / "none") as client:
        assert "/openapi.json" in client.get("/").text


def test_the_apis_pages_need_no_other_site(api: httpx.Client) -> None:
    page = api.get("/docs")
    assert page.status_code == 200
    sources = re.findall(r"(?:src|href)=\"([^\"]+)\"", page.text)
    assert sources
    for source in sources:
        assert source.startswith("/")
        assert api.get(source).status_code == 200


@pytest.fixture
def build(tmp_path: Path) -> Path:
    folder = tmp_path / "dist"
    (folder / "assets").mkdir(parents=True)
    (folder / "index.html").write_text("<title>VisCo</title>")
    (folder / "assets" / "main-1a2b.js").write_text("export {}")
    return folder


def test_a_built_dashboard_is_served_under_a_strict_policy(tmp_path: Path, build: Path) -> None:
    with running_api(make_settings(tmp_path), dashboard=build) as client:
        for path in ("/", "/jobs/01m81c3br57vkdrkjhzc6d7x41"):
            page = client.get(path)
            assert page.text == "<title>VisCo</title>"
            assert "script-src 'self'" in page.headers["Content-Security-Policy"]
            assert "unsafe" not in page.headers["Content-Security-Policy"]
            assert page.headers["Cache-Control"] == "no-cache"
        asset = client.get("/assets/main-1a2b.js")
        assert "immutable" in asset.headers["Cache-Control"]
        for path in ("/assets/gone.js", "/v1/nothing"):
            missing = client.get(path)
            assert (missing.status_code, missing.json()["code"]) == (404, "not_found")
        assert client.get("/v1/healthz").json() == {"status": "ok"}


def test_the_dashboard_hides_no_refusal_of_the_api(tmp_path: Path, build: Path) -> None:
    with running_api(make_settings(tmp_path), dashboard=build) as client:
        for method, path, status in (
            ("GET", "/v1/uploads", 405),
            ("DELETE", "/v1/options", 405),
            ("DELETE", "/v1/nothing", 404),
            ("GET", "/v1", 404),
        ):
            refused = client.request(method, path)
            assert refused.status_code == status, (method, path)
            assert refused.headers["content-type"] == "application/problem+json"
        assert client.get("/v1/uploads").headers["Allow"] == "OPTIONS, POST"
