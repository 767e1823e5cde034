"""Ctrl-C while something long is worked out: it ends the command, wherever it arrives.

Compiled libraries call Python back: numpy to compare rows, the kernels' compiler to keep what it
has compiled. A KeyboardInterrupt raised in such a place is dropped there, or comes out as another
error. (asyncio takes Ctrl-C in its own way, which has neither fault; see `lmctl.run.signals`.)
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """In the context, or a function decorated with it, Ctrl-C always is a KeyboardInterrupt.

    So are a termination and a hang-up, which would leave half-written files behind; a signal that
    is ignored (a hang-up under nohup) stays ignored. Yields a function for the steps of a long
    work to call: it raises KeyboardInterrupt where one was dropped since. At the latest the end of
    the context does. Outside the main thread signals cannot be taken; there this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    heard = False

    def hear(number: int, frame: FrameType | None) -> None:
        nonlocal heard
        heard = True
        raise KeyboardInterrupt

    def unraisable(dropped: sys.UnraisableHookArgs) -> None:
        if dropped.exc_type is not KeyboardInterrupt:
            report(dropped)

    def check() -> None:
        if heard:
            raise KeyboardInterrupt

    before = {
        number: handler for number in _SIGNALS
        if (handler := signal.getsignal(number)) not in (signal.SIG_IGN, None)
    }
    for number in before:
        signal.signal(number, hear)
    report, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        yield check
        check()
    except Exception:
        check()  # then this is what a library has made of the interrupt
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = report
