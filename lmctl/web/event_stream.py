"""Server-sent events to one viewer; a viewer that reads nothing is dropped and holds no memory."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from starlette.types import Receive, Scope, Send

from lmctl.web.run_watch import RunWatch

#: A comment goes out so often where nothing else does [s], so that a dead connection is noticed.
_ALIVE_S = 5.0

#: A viewer that takes nothing for so long is dropped [s].
SLOW_S = 20.0


class EventStream:
    """An answer that lasts until the viewer leaves. An ASGI application."""

    def __init__(self, watch: RunWatch) -> None:
        self._watch = watch

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        viewer = self._watch.add_viewer()

        async def push() -> None:
            await send({"type": "http.response.start", "status": 200, "headers": [
                (b"content-type", b"text/event-stream"), (b"x-accel-buffering", b"no")]})
            while True:
                chunk = await viewer.next_chunk(_ALIVE_S)
                async with asyncio.timeout(SLOW_S):
                    await send({"type": "http.response.body", "body": chunk, "more_body": True})

        pushing = asyncio.ensure_future(push())
        leaving = asyncio.ensure_future(_left(receive))
        try:
            await asyncio.wait({pushing, leaving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._watch.remove_viewer(viewer)
            for task in (pushing, leaving):
                task.cancel()
            with suppress(OSError, TimeoutError):
                await asyncio.gather(pushing, leaving, return_exceptions=True)


async def _left(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
