"""The callbacks through which a controller connection reports what it receives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_protocol.status import StatusReport


@dataclass
class ConnectionCallbacks:
    """Callables that receive what the controller reports.

    accepted(count) for `ok`s in a row, rejected(tag, error), report(report) for each that is
    believed, alarm(code), restarted(asked) in stream order;
    surplus_answer() for an answer that belongs to no line; batch_done() after each arrival of
    bytes; asking() before each `?`: what is written then goes with it; lost(reason) once.
    """

    on_ok: Callable[[int], None]
    on_rejected: Callable[[int, int], None]
    on_report: Callable[[StatusReport], None]
    on_alarm: Callable[[int], None]
    on_restart: Callable[[bool], None]
    on_batch_done: Callable[[], None]
    on_lost: Callable[[str], None]
    on_surplus_reply: Callable[[], None] = lambda: None
    on_query: Callable[[], None] = lambda: None
