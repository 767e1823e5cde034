"""What one viewer of the live page has still to receive, in bounded memory.

Of snapshots only the latest is worth sending; curves and events are kept up to a limit. A viewer
that falls further behind is sent everything anew.
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable
from typing import Any

_MOST_WAITING_BYTES = 1_000_000


def sse_message(event: str, data: Any) -> bytes:
    """One server-sent event."""
    return f"event: {event}\ndata: {json.dumps(data, separators=(',', ':'))}\n\n".encode("ascii")


class ViewerQueue:
    """Messages for one viewer. everything : makes the message that a new viewer starts with."""

    def __init__(self, everything: Callable[[], bytes]) -> None:
        self._everything = everything
        self._snapshot: bytes | None = None
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._anew = True
        self._changed = asyncio.Event()
        self._changed.set()

    def offer_snapshot(self, message: bytes) -> None:
        """A newer snapshot, in place of one that has not been sent."""
        self._snapshot = message
        self._changed.set()

    def offer(self, message: bytes) -> None:
        """Something that must not be left out."""
        if not self._anew:
            self._waiting.append(message)
            self._waiting_bytes += len(message)
            if self._waiting_bytes > _MOST_WAITING_BYTES:
                self.start_anew()
        self._changed.set()

    def start_anew(self) -> None:
        """Send everything again."""
        self._anew, self._snapshot, self._waiting_bytes = True, None, 0
        self._waiting.clear()
        self._changed.set()

    async def next_chunk(self, timeout_s: float) -> bytes:
        """What is to be sent next; a comment where nothing has come within the time-out [s]."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._changed.wait()
        except TimeoutError:
            return b": nothing new\n\n"
        self._changed.clear()
        if self._anew:
            self._anew = False
            return self._everything()
        chunk = b"".join(self._waiting) + (self._snapshot or b"")
        self._waiting.clear()
        self._snapshot, self._waiting_bytes = None, 0
        return chunk
