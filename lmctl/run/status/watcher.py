"""Sends status snapshots of a run to its watcher periodically."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

#: State of a run; see `lmctl.run.status.snapshot`.
Snapshot = dict[str, Any]

Watcher = Callable[[Snapshot], None]

#: Of machine time, between two snapshots [s].
_EVERY_S = 1.0


@contextmanager
def periodic_watcher_updates(snapshot: Callable[[], Snapshot],
                             watcher: Watcher | None) -> Iterator[None]:
    """Call a watcher once a second of the loop's time, and at the end; None: no watcher."""
    if watcher is None:
        yield
        return
    show = watcher

    async def show_on() -> None:
        while True:
            show(snapshot())
            await asyncio.sleep(_EVERY_S)

    showing = asyncio.create_task(show_on(), name="run watcher")
    try:
        yield
    finally:
        showing.cancel()
        show(snapshot())
