"""The first reason why a feeder in use can no longer be relied on."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.pmx import Mode, Status
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.modbus.observation import WireObservation

#: Cycles without a good answer, and with a clock that stands still, before a feeder is given up.
_SILENT_CYCLES = 3
_ROUNDING = 1e-6  # of loop times, in cycles
#: Cycles in which a device may take over a recipe it has accepted.
_RECIPE_CYCLES = 2


@dataclass(frozen=True)
class Complaint:
    """What is wrong, as the rest of a sentence that begins with the feeder's name."""

    reason: str
    hint: str


class FeederWatch:
    """Looks at one feeder's answers, each with what was asked of it. period_s : of its cycle."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._last: FeederStatus | None = None
        self._moved_s = 0.0  # when the device's clock was last seen to move
        self._behind_since_s: float | None = None  # it has not taken over the recipe since

    def silence(self, age_s: float, seen: WireObservation) -> Complaint | None:
        """What to say of the time since the last good answer. seen : on the wire meanwhile"""
        if age_s < (_SILENT_CYCLES - _ROUNDING) * self._period_s:
            return None
        if not seen.is_anything:  # it answers, but nothing that has a meaning
            return Complaint(f"no usable answer for {age_s:.1f} s", "restart the feeder")
        return Complaint(f"no answer for {age_s:.1f} s: {seen.sentence}", seen.hint)

    def look(self, status: FeederStatus, *, sequence: int, feeding: bool) -> Complaint | None:
        """sequence : of the last recipe accepted. feeding : whether discs were asked to turn."""
        last, self._last = self._last, status
        if last is None or status.tick_ms != last.tick_ms:
            self._moved_s = status.time_s
        if status.seq_applied == sequence:
            self._behind_since_s = None
        elif self._behind_since_s is None:
            self._behind_since_s = status.time_s
        if last is not None and status.uptime_s < last.uptime_s:
            return Complaint("the device restarted", "check its power supply")
        if status.alarm is not None:
            return Complaint(status.alarm.text, status.alarm.hint)
        return (
            self._out_of_command(status, feeding=feeding)
            or self._stale(status)
            or self._ignored_recipe(status, sequence)
        )

    def _out_of_command(self, status: FeederStatus, *, feeding: bool) -> Complaint | None:
        if Status.WATCHDOG_TRIPPED in status.flags:
            return Complaint("its watchdog tripped", "find out why heartbeats stopped")
        if status.mode is not Mode.REMOTE:
            return Complaint(f"its switch was turned to {status.mode.name}", "turn it to REMOTE")
        if Status.REMOTE not in status.flags:
            return Complaint("it has left remote control", "is another host commanding it?")
        if feeding and not status.feeding:
            return Complaint(
                f"powder stopped by itself (state {status.state.name})", "see its own display"
            )
        return None

    def _stale(self, status: FeederStatus) -> Complaint | None:
        still_s = status.time_s - self._moved_s
        if still_s < (_SILENT_CYCLES - _ROUNDING) * self._period_s:
            return None
        return Complaint(
            f"it answers, but with the same data for {still_s:.1f} s",
            "restart it, and any gateway before it",
        )

    def _ignored_recipe(self, status: FeederStatus, sequence: int) -> Complaint | None:
        since_s = self._behind_since_s
        if since_s is None or status.time_s - since_s <= _RECIPE_CYCLES * self._period_s:
            return None
        return Complaint(
            f"it runs recipe {status.seq_applied}, not {sequence} as accepted",
            "is another host commanding it?",
        )
