"""The live page as an ASGI application: static files, the REST routes, and what protects both."""

from __future__ import annotations

import time
from importlib.resources import files

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp

from lmctl.web.access import AccessPolicy
from lmctl.web.operator_seat import OperatorSeat
from lmctl.web.protection import RequestProtection
from lmctl.web.rate_limit import RateLimit
from lmctl.web.rest import DashRoutes
from lmctl.web.run_catalogue import RunCatalogue

#: The files of the page, each with its type; nothing else is served.
PAGE_FILES = {
    "index.html": "text/html; charset=utf-8",
    "dash.css": "text/css; charset=utf-8",
    "uPlot.min.css": "text/css; charset=utf-8",
    "uPlot.iife.min.js": "text/javascript; charset=utf-8",
    **dict.fromkeys(
        ("dash.js", "event_stream.js", "layer_view.js", "curves.js", "panels.js", "operator.js"),
        "text/javascript; charset=utf-8"),
}


def dash_application(
    catalogue: RunCatalogue, access: AccessPolicy, rate: RateLimit | None = None
) -> ASGIApp:
    """The application over an open catalogue of runs. rate : as `RequestProtection` takes it"""
    seat = OperatorSeat(time.monotonic)
    folder = files("lmctl.web") / "page"
    loaded = {name: (folder / name).read_bytes() for name in PAGE_FILES}

    async def page_file(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in loaded:
            return Response("there is no such file", status_code=404, media_type="text/plain")
        return Response(loaded[name], media_type=PAGE_FILES[name])

    routes = [Route("/", page_file), Route("/page/{name}", page_file),
              *DashRoutes(catalogue, access, seat).routes()]
    return RequestProtection(Starlette(routes=routes), access, rate=rate)
