"""grblHAL's auxiliary inputs and outputs: M62 to M68 (grblHAL wiki, "Auxiliary I/O")."""

from __future__ import annotations

from typing import NamedTuple

from firmware_protocol.gcode import GcodeError
from simulators.motion.actions import Action, ReadInput, SetOutput

NO_VALUE, OUT_OF_RANGE, BAD_ANALOG = 28, 39, 44

DIGITAL_IN, DIGITAL_OUT, ANALOG_IN, ANALOG_OUT = 4, 8, 0, 4

_WAITS_IN_VAIN = frozenset((1, 3))  # rise or high level: inputs stay low, so the wait times out


class PortActions(NamedTuple):
    """queued : switched when the next move starts; actions : performed at once."""

    queued: tuple[tuple[str, int, float], ...]
    actions: tuple[Action, ...]


def port_actions(code: int | None, values: dict[str, float], used: set[str]) -> PortActions | None:
    """Actions of M62 to M68 in a block; None without one. raises: GcodeError"""
    if code is None:
        return None
    if code in (67, 68):
        used.update("EQ")
        if "E" not in values:
            raise GcodeError(NO_VALUE)
        port = int(values["E"])
        if not 0 <= port < ANALOG_OUT:
            raise GcodeError(BAD_ANALOG)
        # An integer: core 20260817 truncates the value.
        switch = ("A", port, float(int(values.get("Q", 0.0))))
    elif code == 66:
        return _read_input(values, used)
    else:
        used.add("P")
        if "P" not in values:
            raise GcodeError(NO_VALUE)
        port = int(values["P"])
        if port >= DIGITAL_OUT:
            raise GcodeError(OUT_OF_RANGE)
        switch = ("D", port, float(code in (62, 64)))
    if code in (62, 63, 67):
        return PortActions((switch,), ())
    return PortActions((), (SetOutput(*switch),))


def _read_input(values: dict[str, float], used: set[str]) -> PortActions:
    used.update("PELQ")
    if ("P" in values) == ("E" in values):
        raise GcodeError(NO_VALUE)
    mode = int(values.get("L", 0.0))
    if "E" in values or values["P"] >= DIGITAL_IN or not 0 <= mode <= 4:
        raise GcodeError(OUT_OF_RANGE)
    if mode not in _WAITS_IN_VAIN:
        return PortActions((), (ReadInput(0.0, 0),))
    if values.get("Q", 0.0) <= 0.0:
        raise GcodeError(NO_VALUE)
    return PortActions((), (ReadInput(values["Q"], -1),))
