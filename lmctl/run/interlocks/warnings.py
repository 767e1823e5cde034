"""Feeder warnings of a run: reported when they appear and when they are over.

A warning stops nothing. An intermittent warning is reported once: it is over only after it has
stayed away for `WARNING_CLEAR_S`, so that a flickering bit does not fill the journal.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from firmware_protocol.pmx_alarms import CLIPPED
from lmctl.machine.feeder.warnings import FeederWarning

#: How long a warning must stay away to be over [s].
WARNING_CLEAR_S = 60.0

_Key = tuple[int, str]


class WarningDebounce:
    """The warnings of one feeder in one run.

    notify : called with each warning when it appears (True) and when it is over (False)
    """

    def __init__(self, notify: Callable[[FeederWarning, bool], None]) -> None:
        self._notify = notify
        self._loop = asyncio.get_running_loop()
        self._latest: Sequence[FeederWarning] = ()
        self._active: dict[_Key, FeederWarning] = {}
        self._leaving: dict[_Key, asyncio.TimerHandle] = {}

    def update(self, warnings: Sequence[FeederWarning]) -> None:
        """Take the feeder's present warnings; the same object means that they are unchanged."""
        if warnings is self._latest:
            return
        self._latest = warnings
        # A clipped set-point holds the run: that is an alarm, and not reported twice.
        now = {(one.number, one.hopper): one for one in warnings if one.number != CLIPPED}
        for key in self._active:
            if key not in now and key not in self._leaving:
                self._leaving[key] = self._loop.call_later(WARNING_CLEAR_S, self._on_absent, key)
        for key, one in now.items():
            if key in self._leaving:
                self._leaving.pop(key).cancel()
            if key not in self._active:
                self._active[key] = one
                self._notify(one, True)

    def stop(self) -> None:
        """The run is over: report nothing more."""
        for timer in self._leaving.values():
            timer.cancel()

    def _on_absent(self, key: _Key) -> None:
        del self._leaving[key]
        self._notify(self._active.pop(key), False)
