"""The web application."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from importlib.metadata import version
from pathlib import Path

from fastapi import APIRouter, FastAPI
from fastapi_offline import FastAPIOffline

from service.api import handlers
from service.api.container import Services
from service.api.front_page import BUILD, add_front_page
from service.api.middleware import RequestContext
from service.api.routes import artifacts, health, jobs, options, uploads
from service.housekeeping import Housekeeper
from service.openapi import describe
from service.settings import Settings


def create_app(settings: Settings, dashboard: Path = BUILD) -> FastAPI:
    """The application over these settings; nothing is opened before it starts.

    ``dashboard`` is the folder of the built pages; without it ``/`` says where the API's are.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        parts = Services.build(settings)
        app.state.services = parts
        keeper = Housekeeper(parts)
        parts.feed.start()
        keeper.start()
        try:
            yield
        finally:
            await keeper.close()
            await parts.feed.close()
            parts.close()

    # The pages of the documentation come from this process: no part of it needs another site.
    app = FastAPIOffline(
        redoc_url=None,
        title="VisCo",
        version=version("visco"),
        summary="Scanned point clouds in, surface meshes out.",
        lifespan=lifespan,
    )
    app.add_middleware(RequestContext)
    handlers.install(app)
    api = APIRouter(prefix="/v1")
    for module in (jobs, artifacts, uploads, options, health):
        api.include_router(module.router)
    app.include_router(api)
    # Probes look for these at the root.
    app.include_router(health.router, include_in_schema=False)
    add_front_page(app, dashboard)
    app.openapi = partial(describe, app)
    return app
