"""What a conversation with a controller calls with what it receives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_protocol.status import StatusReport


@dataclass
class Hearer:
    """Who is told what the controller says, as callables.

    accepted(count) for `ok`s in a row, rejected(tag, error), report(report) for each that is
    believed, alarm(code), restarted(asked) in stream order;
    surplus_answer() where an answer answers nothing; batch_done() after each arrival of bytes;
    asking() before each `?`: what is written then goes with it; lost(reason) once.
    """

    accepted: Callable[[int], None]
    rejected: Callable[[int, int], None]
    report: Callable[[StatusReport], None]
    alarm: Callable[[int], None]
    restarted: Callable[[bool], None]
    batch_done: Callable[[], None]
    lost: Callable[[str], None]
    surplus_answer: Callable[[], None] = lambda: None
    asking: Callable[[], None] = lambda: None
