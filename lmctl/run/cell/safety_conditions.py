"""What a run requires of the safety-input device before anything moves: its interlocks."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.config.machine import SafetySettings
from lmctl.errors import ConfigError
from lmctl.machine.safety.identity import check_serial_line
from lmctl.machine.safety.status import SafetyStatus
from lmctl.run.cell.condition import StartCondition
from lmctl.run.interlocks.inputs import InterlockInputs, ProgramDeviation
from lmctl.run.interlocks.rule import InterlockFinding
from lmctl.run.interlocks.rules import INTERLOCK_RULES


def safety_conditions(status: SafetyStatus, limits: SafetySettings) -> Iterator[StartCondition]:
    """limits : the table [safety] of the profile."""
    try:
        check_serial_line(limits)
    except ConfigError as error:
        yield StartCondition(False, "; ".join([error.what, *error.where]), error.hint,
                             refuses_run=True)
    yield StartCondition(status.self_test_ok,
                         "self-test " + ("passed" if status.self_test_ok else "failed"),
                         "see the device's own display", refuses_run=True)
    wrong = list(_interlocks(status, limits))
    if not wrong:
        yield StartCondition(True, "every fitted input is good, every value within its limits")
    for one in wrong:
        yield StartCondition(False, one.text, one.remedy, refuses_run=True)
    oxygen_ppm, warn_ppm, trip_ppm = (
        status.oxygen_ppm, limits.oxygen_warn_ppm, limits.oxygen_trip_ppm
    )
    if (
        oxygen_ppm is not None and warn_ppm is not None and oxygen_ppm > warn_ppm
        and (trip_ppm is None or oxygen_ppm <= trip_ppm)  # else it is among the interlocks
    ):
        yield StartCondition(False,
                             f"oxygen is at {oxygen_ppm:g} ppm, a warning from {warn_ppm:g} ppm "
                               "on", "purge the chamber")
    if status.first_out is not None:
        yield StartCondition(True,
                             f"what opened first since the last reset: {status.first_out.text}")


def _interlocks(status: SafetyStatus, limits: SafetySettings) -> Iterator[InterlockFinding]:
    """Interlocks that hold just now. (An open watchdog relay is closed by a run itself.)"""
    facts = InterlockInputs(motion=None, standstill_s=0.0, deviation=ProgramDeviation(),
                            motion_age_s=0.0,
                            motion_period_s=1.0, feeders=(), feeder_readings=(),
                            safety=status, safety_age_s=0.0, limits=limits)
    for rule in INTERLOCK_RULES:
        if rule.needs_safety_device and not rule.is_latched:
            yield from rule.find(facts)
