"""The first reason why a feeder in use can no longer be relied on."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.pmx import FeederMode, FeederStatusBits
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.modbus.observation import WireObservation

#: Cycles without a good answer, and with a stopped device clock, before a feeder is given up.
_SILENT_CYCLES = 3
_ROUNDING = 1e-6  # of loop times, in cycles
#: Cycles in which a device may take over a recipe it has accepted.
_RECIPE_CYCLES = 2


@dataclass(frozen=True)
class FeederFault:
    """What is wrong, as the rest of a sentence that begins with the feeder's name."""

    reason: str
    hint: str


class FeederMonitor:
    """Checks one feeder's answers against its orders. period_s : of its cycle."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._last: FeederStatus | None = None
        self._restarted = False  # while monitored, also before a run relied on it
        self._moved_s = 0.0  # when the device's clock was last seen to move
        self._behind_since_s: float | None = None  # it has not taken over the recipe since

    def silence_fault(self, age_s: float, seen: WireObservation) -> FeederFault | None:
        """The fault for the time since the last good answer. seen : on the wire since then"""
        if age_s < (_SILENT_CYCLES - _ROUNDING) * self._period_s:
            return None
        if not seen.has_anomalies:  # it answers, but nothing that has a meaning
            return FeederFault(f"no usable answer for {age_s:.1f} s", "restart the feeder")
        return FeederFault(f"no answer for {age_s:.1f} s: {seen.description}", seen.hint)

    def find_fault(self, status: FeederStatus, *, sequence: int,
                   feeding: bool) -> FeederFault | None:
        """sequence : of the last recipe accepted. feeding : whether discs were asked to turn."""
        last, self._last = self._last, status
        if last is None or status.tick_ms != last.tick_ms:
            self._moved_s = status.time_s
        if status.seq_applied == sequence:
            self._behind_since_s = None
        elif self._behind_since_s is None:
            self._behind_since_s = status.time_s
        if last is not None and status.uptime_s < last.uptime_s:
            self._restarted = True
        if self._restarted:
            return FeederFault("the device restarted", "check its power supply")
        if status.alarm is not None:
            return FeederFault(status.alarm.text, status.alarm.remedy)
        return (
            self._out_of_command(status, feeding=feeding)
            or self._stale(status)
            or self._ignored_recipe(status, sequence)
        )

    def _out_of_command(self, status: FeederStatus, *, feeding: bool) -> FeederFault | None:
        if FeederStatusBits.WATCHDOG_TRIPPED in status.flags:
            return FeederFault("its watchdog tripped", "find out why heartbeats stopped")
        if status.mode is not FeederMode.REMOTE:
            return FeederFault(f"its switch was turned to {status.mode.name}", "turn it to REMOTE")
        if FeederStatusBits.REMOTE not in status.flags:
            return FeederFault("it has left remote control", "is another host commanding it?")
        if feeding and not status.feeding:
            return FeederFault(
                f"powder stopped by itself (state {status.state.name})", "see its own display"
            )
        return None

    def _stale(self, status: FeederStatus) -> FeederFault | None:
        still_s = status.time_s - self._moved_s
        if still_s < (_SILENT_CYCLES - _ROUNDING) * self._period_s:
            return None
        return FeederFault(
            f"it answers, but with the same data for {still_s:.1f} s",
            "restart it, and any gateway before it",
        )

    def _ignored_recipe(self, status: FeederStatus, sequence: int) -> FeederFault | None:
        since_s = self._behind_since_s
        if since_s is None or status.time_s - since_s <= _RECIPE_CYCLES * self._period_s:
            return None
        return FeederFault(
            f"it runs recipe {status.seq_applied}, not {sequence} as accepted",
            "is another host commanding it?",
        )
