"""Warnings of a feeder that keeps running: which hopper, in words, with a remedy.

WARNING has one bit per warning, shared by all hoppers. Each hopper's own flags report low levels
and clipped set-points; other warnings name a hopper only where there is just one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from firmware_protocol.pmx import HopperStatusBits
from firmware_protocol.pmx_alarms import (
    CLIPPED,
    DRIFT,
    LEVEL_LOW,
    FeederAlarm,
    describe_warnings,
)
from lmctl.machine.feeder.readings import HopperReading

#: Number of warnings about what a device lacks; beyond those that a device reports itself.
SUBSTITUTED = 90
#: What is reported for as long as such a device is used, with what to do.
SUBSTITUTE_REMEDIES = {
    "watchdog": "see that the relay is wired and stops powder: pull this host's cable once to try",
    "gas": "open the gas before powder, and keep it open until the hose is empty",
}

_OWN_FLAG = {LEVEL_LOW: HopperStatusBits.LEVEL_LOW, CLIPPED: HopperStatusBits.LIMITED}


class FeederWarning(NamedTuple):
    """number : 51 for a low level to 55 for a clipped set-point

    Source: docs/explanation/powder-delivery.md, Feeders.

    hopper : by name, "" where the feeder does not report which
    text, remedy : for operators; figures are those at the time the warning appeared
    """

    number: int
    feeder: str
    hopper: str
    text: str
    remedy: str


class WarningReader:
    """Puts one feeder's word WARNING into words. names : of the hoppers in use, by channel.

    n_hoppers : of the device; a level or set-point of a hopper not in use is not reported
    alarms : its alarms by code, where they are not those of a PMX
    substitutions : what it lacks, and what takes its place: the dangerous ones are always reported
    """

    def __init__(
        self, feeder: str, names: Mapping[int, str], n_hoppers: int, *,
        alarms: Mapping[int, FeederAlarm] | None = None,
        substitutions: Iterable[tuple[str, str]] = (),
    ) -> None:
        self.names = names
        self.alarms = alarms or {}
        self._lasting = tuple(
            FeederWarning(SUBSTITUTED, feeder, "", f"feeder {feeder} has no {feature}: {meaning}",
                          SUBSTITUTE_REMEDIES[feature])
            for feature, meaning in substitutions if feature in SUBSTITUTE_REMEDIES)
        self._feeder = feeder
        self._only = next(iter(names.values()), "") if n_hoppers == 1 else ""
        self._word = 0
        self._hoppers: Mapping[str, HopperReading] = {}
        self._active = self._lasting

    def read(
        self, word: int, hoppers: Mapping[str, HopperReading]
    ) -> tuple[FeederWarning, ...]:
        """The warnings active now; the same object as before where nothing has changed.

        hoppers : as last read, the same object until they are read again; before they have been
            read for the first time, nothing is reported
        """
        if (word == self._word and (not word or hoppers is self._hoppers)) or not hoppers:
            return self._active
        self._word, self._hoppers = word, hoppers
        known = {(one.number, one.hopper): one for one in self._active}
        active = self._lasting + tuple(
            known.get((one.code, hopper))
            or FeederWarning(one.code, self._feeder, hopper, self._place(hopper) + one.text
                             + _figures(one.code, hopper, hoppers), one.remedy)
            for one in describe_warnings(word)
            for hopper in self._of(one.code, hoppers)
        )
        if active != self._active:
            self._active = active
        return self._active

    def _of(self, number: int, hoppers: Mapping[str, HopperReading]) -> Iterable[str]:
        flag = _OWN_FLAG.get(number)
        if flag is None:
            return (self._only,)
        return [name for name, reading in hoppers.items() if flag in reading.flags]

    def _place(self, hopper: str) -> str:
        if hopper:
            return f"hopper {hopper} of feeder {self._feeder}: "
        return f"feeder {self._feeder}, one of its hoppers: "


def _figures(number: int, hopper: str, hoppers: Mapping[str, HopperReading]) -> str:
    """The reading that shows it, where one does."""
    if number == LEVEL_LOW:
        reading = hoppers[hopper]
        said = [] if reading.level_percent is None else [f"{reading.level_percent:.0f} %"]
        said += [] if reading.weight_g is None else [f"{reading.weight_g:.0f} g left"]
    elif number == DRIFT:
        said = [
            f"{name} {one.flow_weighed_g_min:.2f} of {one.flow_estimated_g_min:.2f} g/min"
            for name, one in hoppers.items()
            if one.flow_weighed_g_min is not None and one.flow_estimated_g_min is not None
        ]
    else:
        said = []
    return f" ({', '.join(said)})" if said else ""
