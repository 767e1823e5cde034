"""The page's own interface for programs: runs, snapshots, events, layers, reports, acts (REST).

Reading needs a viewer's role, acting an operator's and the seat (docs/reference/live-page.md).
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from lmctl import __version__
from lmctl.errors import JournalError, LmctlError, MissingFileError, UsageError
from lmctl.run.control.server import ACTIONS
from lmctl.web.access import AccessPolicy, AccessRole
from lmctl.web.control_link import ControlLink
from lmctl.web.event_stream import EventStream
from lmctl.web.metrics import metrics_text
from lmctl.web.operator_seat import OperatorSeat
from lmctl.web.report_process import report_as_html_apart
from lmctl.web.run_catalogue import RunCatalogue
from lmctl.web.run_watch import encoded

#: Most viewers that are sent events at a time.
MAX_VIEWERS = 100

#: What an act of the live page may carry, besides what the control socket takes.
_ACT_KEYS = frozenset({"act", "number", "seen_state"})
_VALUE_KEYS = frozenset({"percent", "hopper", "lot", "mass_g", "height_mm"})

_Handler = Callable[[Request], Awaitable[Any]]


class _RefusedError(Exception):
    """An answer with this status. error : in the form of every other error of ours"""

    def __init__(self, status: int, error: LmctlError) -> None:
        super().__init__(error.what)
        self.status, self.error = status, error


class DashRoutes:
    """The routes of one page over one folder of runs."""

    def __init__(
        self, catalogue: RunCatalogue, access: AccessPolicy, seat: OperatorSeat
    ) -> None:
        self._catalogue = catalogue
        self._access = access
        self._seat = seat
        self._viewers = 0

    def routes(self) -> list[Route]:
        """All of them, for an application."""
        reading: list[tuple[str, _Handler]] = [
            ("/api/session", self._session), ("/api/runs", self._runs),
            ("/api/runs/{run}", self._snapshot), ("/api/runs/{run}/events", self._events),
            ("/api/runs/{run}/layers/{layer:int}", self._layer),
            ("/api/runs/{run}/report.html", self._report), ("/metrics", self._metrics),
        ]
        return [
            *(Route(path, _answering(handler, AccessRole.VIEWER)) for path, handler in reading
              if path != "/api/session"),
            Route("/api/session", _answering(self._session, AccessRole.NONE)),
            Route("/api/seat", _answering(self._take_seat, AccessRole.OPERATOR), methods=["POST"]),
            Route("/api/seat", _answering(self._leave_seat, AccessRole.OPERATOR),
                  methods=["DELETE"]),
            Route("/api/runs/{run}/acts", _answering(self._act, AccessRole.OPERATOR),
                  methods=["POST"]),
        ]

    async def _session(self, request: Request) -> Any:
        """What this request may do, and who operates; keeps the seat of the one who asks."""
        role = request.state.role
        is_reader, has_seat = role >= AccessRole.VIEWER, False
        if role is AccessRole.OPERATOR:
            with suppress(UsageError):
                has_seat = bool(self._seat.holder_of(request.headers.get("x-operator-seat")))
        return {"role": role.name.lower(), "has_seat": has_seat,
                "software": f"lmctl {__version__}",
                "operator": self._seat.operator if is_reader else "",
                "runs_dir": str(self._catalogue.runs_dir.absolute()) if is_reader else ""}

    async def _runs(self, _: Request) -> Any:
        return {"runs": await self._catalogue.listed_runs()}

    async def _snapshot(self, request: Request) -> Any:
        return (await self._catalogue.watch(request.path_params["run"])).snapshot()

    async def _events(self, request: Request) -> Any:
        if self._viewers >= MAX_VIEWERS:
            raise _RefusedError(503, UsageError(
                f"{MAX_VIEWERS} viewers look at this page already", hint="try again later"))
        watch = await self._catalogue.watch(request.path_params["run"])
        return _CountedStream(watch, self)

    async def _layer(self, request: Request) -> Any:
        watch = await self._catalogue.watch(request.path_params["run"])
        if watch.job is None:
            raise JournalError(f"the job of {watch.folder.run} cannot be read",
                               hint="see that the job is still beside the run, as job.lmj")
        return await asyncio.to_thread(watch.job.layer_as_json, request.path_params["layer"])

    async def _report(self, request: Request) -> Any:
        watch = await self._catalogue.watch(request.path_params["run"])
        page = await report_as_html_apart(watch.folder.journal)
        name = f"report-{watch.folder.run}.html"
        return Response(page, media_type="text/html; charset=utf-8", headers={
            "Content-Disposition": f'attachment; filename="{name}"',
            "Content-Security-Policy":
                "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"})

    async def _metrics(self, _: Request) -> Any:
        text = metrics_text(self._catalogue.live_snapshots())
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    async def _take_seat(self, request: Request) -> Any:
        values = await _values_of(request, {"operator", "take_over"})
        key = self._seat.take(values.get("operator"), _address(request),
                              take_over=values.get("take_over") is True)
        return {"seat": key, "operator": self._seat.operator}

    async def _leave_seat(self, request: Request) -> Any:
        self._holder(request)
        self._seat.leave(request.headers.get("x-operator-seat"))
        return {"operator": ""}

    async def _act(self, request: Request) -> Any:
        """Perform an act as the operator who has the seat; it is journaled with the name."""
        values = await _values_of(request, _ACT_KEYS | _VALUE_KEYS)
        act, seen_state = values.get("act"), values.get("seen_state")
        if act not in ACTIONS:
            raise _RefusedError(400, UsageError(f'"act" is one of {", ".join(ACTIONS)}'))
        operator = self._holder(request)
        watch = await self._catalogue.watch(request.path_params["run"])
        async with ControlLink(watch.folder.path) as link:
            state = (await link.request("status"))["state"]
            if seen_state != state:
                raise UsageError(f"cannot {act}: the run is {state}, and you saw {seen_state}",
                                 hint="look at the state, and act anew")
            self._seat.accept_number(values.get("number"))
            return await link.request(act, operator=operator, **{
                name: value for name, value in values.items() if name in _VALUE_KEYS})

    def _holder(self, request: Request) -> str:
        """The name under which the one in the seat acts; refuses everybody else."""
        try:
            return self._seat.holder_of(request.headers.get("x-operator-seat"))
        except UsageError as error:
            raise _RefusedError(403, error) from None

    # --- viewers ------------------------------------------------------------------------------

    def count_viewer(self, change: int) -> None:
        """A viewer has come (1) or gone (-1)."""
        self._viewers += change


class _CountedStream(EventStream):
    def __init__(self, watch: Any, routes: DashRoutes) -> None:
        super().__init__(watch)
        self._routes = routes

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self._routes.count_viewer(1)
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._routes.count_viewer(-1)


def _answering(handler: _Handler, least: AccessRole) -> Callable[[Request], Awaitable[Any]]:
    """A handler with its role checked, its value as JSON and its errors as answers."""

    async def answer(request: Request) -> Any:
        try:
            if request.state.role < least:
                raise _RefusedError(401, UsageError(
                    f"this needs the token of {'an operator' if least > 1 else 'a viewer'}",
                    hint="send it as `Authorization: Bearer TOKEN`"))
            found = await handler(request)
        except _RefusedError as refused:
            return _error_answer(refused.status, refused.error)
        except MissingFileError as error:
            return _error_answer(404, error)
        except JournalError as error:
            return _error_answer(503, error)
        except LmctlError as error:
            return _error_answer(409, error)
        if isinstance(found, dict):
            return Response(encoded(found), media_type="application/json")
        return found

    return answer


def _error_answer(status: int, error: LmctlError) -> Response:
    body = {"error": error.what, "where": list(error.where), "hint": error.hint}
    return Response(encoded(body), status_code=status, media_type="application/json")


async def _values_of(request: Request, known: set[str] | frozenset[str]) -> dict[str, Any]:
    """The object in a request's body. Raises UsageError."""
    try:
        values = json.loads(await request.body() or b"{}")
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict):
        raise _RefusedError(400, UsageError("a request is one JSON object"))
    if unknown := sorted(values.keys() - known):
        raise _RefusedError(400, UsageError(f"unknown keys: {', '.join(unknown)}",
                                            where=f"known are {', '.join(sorted(known))}"))
    return values


def _address(request: Request) -> str:
    return "?" if request.client is None else request.client.host
