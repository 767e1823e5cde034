"""Ctrl-C and its kin while a run is under way: a request to stop, never the end of the process.

asyncio's own handler cancels the main task at the first Ctrl-C and tears every task down at the
second, the ones that still have to switch the powder off among them.
"""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def calling(act: Callable[[], object]) -> Iterator[None]:
    """Call `act` at each interrupt, termination or hang-up, as long as the context lasts.

    One that is ignored (hang-up under nohup) stays ignored. Outside the main thread signals
    cannot be taken; there this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    before = {
        number: handler for number in _SIGNALS
        if (handler := signal.getsignal(number)) not in (signal.SIG_IGN, None)
    }
    for number in before:
        loop.add_signal_handler(number, act)
    try:
        yield
    finally:
        for number, handler in before.items():
            loop.remove_signal_handler(number)
            signal.signal(number, handler)
