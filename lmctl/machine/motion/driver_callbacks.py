"""The callbacks through which a motion driver passes on what its controller reports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_protocol.status import StatusReport


def _ignore(*_: object) -> None:
    """Ignore an event that has no listener."""


@dataclass
class MotionCallbacks:
    """Called in the order of the byte stream, from the loop; each must return at once.

    on_question() : a status report is about to be asked for; lines submitted now go with the
        question and cost the wire no turn of their own
    on_progress() : acknowledged or executed has grown
    on_status(report)
    on_error(tag, code) : line `tag` of the stream is the first that was rejected; `!` is on its way
    on_alarm(code)
    on_restart() : the controller restarted without a reset from this host
    on_lost(reason) : the link is gone or the controller silent; nothing follows
    """

    on_query: Callable[[], None] = _ignore
    on_progress: Callable[[], None] = _ignore
    on_status: Callable[[StatusReport], None] = _ignore
    on_error: Callable[[int, int], None] = _ignore
    on_alarm: Callable[[int], None] = _ignore
    on_restart: Callable[[], None] = _ignore
    on_lost: Callable[[str], None] = _ignore
