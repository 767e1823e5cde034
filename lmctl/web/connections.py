"""How long a connection to the page may take to ask something, and to take its answer.

uvicorn bounds the time between two requests only: a client that opens connections and sends
nothing, or takes nothing, could keep all there are.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

#: A connection is looked at so often [s]: one without a request by then is closed, and one that is
#: closing and whose client takes nothing is cut.
LOOK_S = 10.0


class BoundedConnection(H11Protocol):
    """A connection of uvicorn's, with an end to its patience."""

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._timer = asyncio.get_running_loop().call_later(LOOK_S, self._look)

    def connection_lost(self, exc: Exception | None) -> None:
        self._timer.cancel()
        super().connection_lost(exc)

    def _look(self) -> None:
        if self.transport.is_closing():
            self.transport.abort()
            return
        if self.cycle is None:  # no request has come, or not the whole of its header
            self.transport.close()
        self._timer = asyncio.get_running_loop().call_later(LOOK_S, self._look)
