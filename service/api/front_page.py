"""What a browser finds at ``/``: the dashboard, where it has been built."""

from __future__ import annotations

import contextlib
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import PlainTextResponse
from fastapi.staticfiles import StaticFiles
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import Scope

from service.openapi import allowed_methods

BUILD = Path(__file__).resolve().parents[1] / "dashboard" / "dist"
_ABOUT = """\
VisCo turns scanned point clouds into surface meshes.
The API is described at /openapi.json, and for reading at /docs.
"""
# Scripts and styles come from files alone. The viewer reads models from blobs that it made itself.
_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "font-src 'self'",
        "connect-src 'self' blob:",
        "worker-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
_A_YEAR = "public, max-age=31536000, immutable"


def add_front_page(app: FastAPI, build: Path) -> None:
    """Serve the dashboard's build, or a few words without one."""
    if build.is_dir():
        app.mount("/", _Dashboard(directory=build, html=True), name="dashboard")
        return

    @app.get("/", include_in_schema=False)
    def about() -> PlainTextResponse:
        return PlainTextResponse(_ABOUT)


class _Dashboard(StaticFiles):
    """The pages have addresses of their own, such as ``/jobs/ID``, which are all one file."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        if path == "v1" or path.startswith("v1/"):
            # Being at the root, this also gets what no route of the API has taken.
            raise HTTPException(405 if allowed_methods(scope["app"], f"/{path}") else 404)
        if _is_page(path):
            path = "index.html"
        response = await self._smallest(path, scope)
        response.headers["Content-Security-Policy"] = _POLICY
        # Files below assets/ carry a hash of their content in the name.
        kept = path.startswith("assets/") and response.status_code == 200
        response.headers["Cache-Control"] = _A_YEAR if kept else "no-cache"
        response.headers["Vary"] = "Accept-Encoding"
        return response

    async def _smallest(self, path: str, scope: Scope) -> Response:
        """The file, as the build compressed it where it did and the browser takes that."""
        if "gzip" in Headers(scope=scope).get("accept-encoding", ""):
            with contextlib.suppress(HTTPException):
                response = await super().get_response(f"{path}.gz", scope)
                response.headers["Content-Encoding"] = "gzip"
                return response
        return await super().get_response(path, scope)


def _is_page(path: str) -> bool:
    return not Path(path).suffix
