"""Ctrl-C and its kin while a run is under way: a request to stop, never the end of the process.

asyncio's own handler cancels the main task at the first Ctrl-C and tears every task down at the
second, the ones that still have to switch the powder off among them.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # planning takes signals too, and has no loop
    from asyncio import AbstractEventLoop

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def catchable_signals() -> dict[signal.Signals, Any]:
    """Interrupt, termination and hang-up, each with its handler, as far as they can be taken.

    One that is ignored (hang-up under nohup) stays ignored, and only the main thread takes any.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {
        number: handler for number in _SIGNALS
        if (handler := signal.getsignal(number)) not in (signal.SIG_IGN, None)
    }


@contextmanager
def call_on_signal(act: Callable[[], object], loop: AbstractEventLoop) -> Iterator[None]:
    """Call `act` on a loop at each signal that is caught, as long as the context lasts."""
    before = catchable_signals()
    for number in before:
        loop.add_signal_handler(number, act)
    try:
        yield
    finally:
        for number, handler in before.items():
            loop.remove_signal_handler(number)
            signal.signal(number, handler)
