"""Let the thread that drives a machine go before all other work of its computer.

A hold waits for a core where planning, a page or a browser has them all: some milliseconds, with
the beam on. With a real-time priority it is woken at once. Linux gives that to root, and to others
within their limit (`ulimit -r`, `LimitRTPRIO=`); without it a run is an ordinary process.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

#: The least of them: before every ordinary process, behind the system's own.
_PRIORITY = 1


@contextmanager
def real_time_priority() -> Iterator[None]:
    """The calling thread's priority, where the system permits it; as before afterwards.

    Processes and threads that it starts are ordinary ones. For work in real time only: what
    computes without a pause would take a core from all others.
    """
    if sys.platform != "linux":
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(OSError):  # not permitted
        os.sched_setscheduler(
            0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, *before)
