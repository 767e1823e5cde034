"""Ctrl-C during a long computation: it ends the command, wherever it arrives.

Compiled libraries call Python back: numpy to compare rows, the kernels' compiler to keep what it
has compiled. A KeyboardInterrupt raised in such a place is dropped there, or comes out as another
error. (asyncio takes Ctrl-C in its own way, which has neither fault; see `lmctl.run.signals`.)
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from lmctl.run.signals import catchable_signals


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """In the context, or a function decorated with it, Ctrl-C always is a KeyboardInterrupt.

    So are a termination and a hang-up, which would leave half-written files behind, as far as
    they are `catchable_signals`. Yields a function for the steps of a long work to call: it raises
    KeyboardInterrupt where one was dropped since. At the latest the end of the context does.
    """
    interrupted = False

    def on_signal(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True
        raise KeyboardInterrupt

    def unraisable(dropped: sys.UnraisableHookArgs) -> None:
        # Once interrupted, what is dropped on the way out is what a library has made of that.
        if not interrupted and dropped.exc_type is not KeyboardInterrupt:
            report(dropped)

    def check() -> None:
        if interrupted:
            raise KeyboardInterrupt

    before = catchable_signals()
    for number in before:
        signal.signal(number, on_signal)
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
