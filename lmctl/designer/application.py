"""The designer's page as an ASGI application; all but the files of the page needs its token."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Awaitable, Callable
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from lmctl.designer.design_session import DesignSession
from lmctl.designer.part_document import KeyPath
from lmctl.designer.part_preview import SectionView
from lmctl.errors import LmctlError, UsageError
from lmctl.web.access import AccessPolicy, AccessRole
from lmctl.web.protection import RequestProtection

#: The files of the page, each with its type; nothing else is served.
PAGE_FILES = {
    "index.html": "text/html; charset=utf-8",
    "designer.css": "text/css; charset=utf-8",
    "designer.js": "text/javascript; charset=utf-8",
    "numbers.js": "text/javascript; charset=utf-8",
    "surface_view.js": "text/javascript; charset=utf-8",
}


def designer_application(session: DesignSession, access: AccessPolicy) -> ASGIApp:
    """The application over one part file."""
    folder = files("lmctl.designer") / "page"
    loaded = {name: (folder / name).read_bytes() for name in PAGE_FILES}

    async def page_file(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in loaded:
            return Response("there is no such file", status_code=404, media_type="text/plain")
        return Response(loaded[name], media_type=PAGE_FILES[name])

    acts = _DesignerActs(session)
    routes = [
        Route("/", page_file), Route("/page/{name}", page_file),
        Route("/api/design", acts.answering(acts.design)),
        Route("/api/surface", acts.answering(acts.surface)),
        *(Route(f"/api/{name}", acts.answering(handler), methods=["POST"]) for name, handler in (
            ("section", acts.section), ("adjust", acts.adjust), ("undo", acts.undo),
            ("redo", acts.redo), ("save", acts.save), ("verdict", acts.verdict))),
    ]
    return RequestProtection(Starlette(routes=routes), access)


_Handler = Callable[[dict[str, Any]], dict[str, Any]]


class _DesignerActs:
    """What each request does; one at a time, in a thread of its own."""

    def __init__(self, session: DesignSession) -> None:
        self._session = session
        self._one_at_a_time = asyncio.Lock()

    def answering(self, handler: _Handler) -> Callable[[Request], Awaitable[Response]]:
        """A route: refuses strangers, answers errors as data."""

        async def answer(request: Request) -> Response:
            if request.state.role < AccessRole.OPERATOR:
                return JSONResponse({"error": "this page was opened without its token",
                                     "where": [], "hint": "open the address that `lmctl design` "
                                     "printed"}, 401)
            try:
                given = await _given(request)
                async with self._one_at_a_time:
                    return JSONResponse(await asyncio.to_thread(handler, given))
            except LmctlError as error:
                where = [*error.where, *(f"{finding.path}: {finding.reason}"
                                         for finding in getattr(error, "findings", ()))]
                return JSONResponse({"error": error.what, "where": where, "hint": error.hint}, 422)

        return answer

    def design(self, _: dict[str, Any]) -> dict[str, Any]:
        return {"state": self._session.state()}

    def surface(self, _: dict[str, Any]) -> dict[str, Any]:
        return self._session.surface()

    def section(self, given: dict[str, Any]) -> dict[str, Any]:
        return {"section": self._session.section(_view(given))}

    def adjust(self, given: dict[str, Any]) -> dict[str, Any]:
        changed = self._session.adjust(_path(given), _number(given, "value"),
                                       continuing=given.get("continuing") is True)
        return self._redrawn(given, changed)

    def undo(self, given: dict[str, Any]) -> dict[str, Any]:
        return self._redrawn(given, self._session.undo())

    def redo(self, given: dict[str, Any]) -> dict[str, Any]:
        return self._redrawn(given, self._session.redo())

    def save(self, _: dict[str, Any]) -> dict[str, Any]:
        self._session.save()
        return self.design({})

    def verdict(self, given: dict[str, Any]) -> dict[str, Any]:
        layer = given.get("layer")
        if layer is not None and (not isinstance(layer, int) or isinstance(layer, bool)):
            raise UsageError("layer is a whole number", hint="layers are counted from 1")
        return self._session.verdict(layer)

    def _redrawn(self, given: dict[str, Any], changed: bool) -> dict[str, Any]:
        """What an edit changes on the page, which asks for the surface when a movement ends."""
        answer = {"state": self._session.state(), "section": self._session.section(_view(given)),
                  "solid_changed": changed}
        return answer if changed else {**answer, **self._session.colours()}


async def _given(request: Request) -> dict[str, Any]:
    body = await request.body()
    if not body:
        return {}
    try:
        given = json.loads(body)
    except ValueError:
        given = None
    if not isinstance(given, dict):
        raise UsageError("a request holds one JSON object", hint="see docs/designer.md")
    return given


def _number(given: dict[str, Any], key: str) -> float:
    value = given.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{key} is a number", hint="send a number")
    return float(value)


def _view(given: dict[str, Any]) -> SectionView:
    axis = given.get("axis")
    if axis not in (0, 1, 2) or isinstance(axis, bool):
        raise UsageError("axis is 0, 1 or 2", hint="send 0 for x, 1 for y, 2 for z")
    return SectionView(int(axis), _number(given, "at_mm"))


def _path(given: dict[str, Any]) -> KeyPath:
    path = given.get("path")
    if not isinstance(path, list) or not path or not all(
            isinstance(key, str | int) and not isinstance(key, bool) for key in path):
        raise UsageError("path is a list of keys", hint="send the keys one by one")
    return tuple(path)
