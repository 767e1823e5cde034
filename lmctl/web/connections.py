"""How long a connection to the page may take to ask something, and how often an address may ask.

uvicorn bounds the time between two requests only: a client that opens connections and sends
nothing, or takes nothing, could keep all there are. And it parses every request before anything of
ours sees it: a flood that is refused then still takes a whole core of a computer that also drives a
machine. So an address that has asked too often is answered before its request is parsed.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from lmctl.web.rate_limit import RateLimit

#: A connection is looked at so often [s]: one without a request by then is closed, and one that is
#: closing and whose client takes nothing is cut.
LOOK_S = 10.0


class BoundedConnection(H11Protocol):
    """A connection of uvicorn's, with an end to its patience.

    rate : of requests, by address; shared with what counts them
    refusal : the answer, as it goes out, to a request of an address that has none left
    """

    def __init__(
        self, *arguments: Any, rate: RateLimit, refusal: bytes, **keywords: Any
    ) -> None:
        super().__init__(*arguments, **keywords)
        self._rate = rate
        self._refusal = refusal

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._timer = asyncio.get_running_loop().call_later(LOOK_S, self._look)

    def connection_lost(self, exc: Exception | None) -> None:
        self._timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        # What belongs to a request that was let in (its body) is none of the next ones.
        is_new = self.cycle is None or self.cycle.response_complete
        if is_new and self.client is not None and self._rate.is_exhausted(self.client[0]):
            if not self.transport.is_closing():
                self.transport.write(self._refusal)
                self.transport.close()
            return
        super().data_received(data)

    def _look(self) -> None:
        if self.transport.is_closing():
            self.transport.abort()
            return
        if self.cycle is None:  # no request has come, or not the whole of its header
            self.transport.close()
        self._timer = asyncio.get_running_loop().call_later(LOOK_S, self._look)
