"""Rules about what the safety-input device sees of the cell."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.run.interlocks.inputs import STALE_PERIODS, InterlockInputs
from lmctl.run.interlocks.rule import InterlockFinding

CLOSE_AND_RESUME_HINT = "close it; look at the part, then resume"


def estop_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.safety is not None and facts.safety.estop_closed is False:
        yield InterlockFinding(
            "the emergency stop chain is open",
            "release the emergency stop, reset the safety circuit, home the machine")


def door_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.safety is not None and facts.safety.door_closed is False:
        yield InterlockFinding("the safety door is open", CLOSE_AND_RESUME_HINT)


def laser_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    safety = facts.safety
    if safety is None:
        return
    for good, what, hint in (
        (safety.laser_healthy, "the laser reports a fault", "see the laser's own display"),
        (safety.no_back_reflection, "the laser sees back-reflection",
         "look at the protective glass and at the melt pool"),
        (safety.laser_ready, "the laser is not ready", "see the laser's own display"),
        (safety.key_on, "the laser's key switch is off", "turn the key"),
    ):
        if good is False:
            yield InterlockFinding(what, hint, what)


def chiller_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    if safety.chiller_ok is False:
        yield InterlockFinding("the chiller does not cool",
                               "check its flow, level and fault display")
    else:
        yield from _beyond("the chiller flows at", safety.chiller_L_min, "L/min",
                           "check its pump and level", least=limits.chiller_min_L_min)
        yield from _beyond("the chiller is at", safety.chiller_C, "°C", "let it cool down",
                           most=limits.chiller_max_C)


def shield_gas_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    hint = "check bottle, regulator and valve"
    if safety.shield_gas_ok is False:
        yield InterlockFinding("shield gas is missing", hint)
    else:
        yield from _beyond("shield gas flows at", safety.shield_gas_L_min, "L/min", hint,
                           least=limits.shield_gas_min_L_min)


def oxygen_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    if safety.oxygen_valid is False:
        yield InterlockFinding("the oxygen analyser gives no valid reading",
                               "check it; what it does not see counts as too much", "analyser")
    else:
        yield from _beyond("oxygen is at", safety.oxygen_ppm, "ppm", "purge the chamber",
                           most=limits.oxygen_trip_ppm)


def _beyond(
    what: str, value: float | None, unit: str, hint: str, *, least: float | None = None,
    most: float | None = None,
) -> Iterator[InterlockFinding]:
    """A value below its least or above its most; one that is unknown is both."""
    said = "an unknown value" if value is None else f"{value:g} {unit}"
    if least is not None and (value is None or value < least):
        yield InterlockFinding(f"{what} {said}, {least:g} {unit} is needed", hint)
    if most is not None and (value is None or value > most):
        yield InterlockFinding(f"{what} {said}, {most:g} {unit} is allowed", hint)


def watchdog_relay_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.safety is not None and facts.safety.relay_closed is False:
        yield InterlockFinding("the watchdog relay is open", "find out why heartbeats stopped")


def extraction_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.safety is not None and facts.safety.extraction_ok is False:
        yield InterlockFinding("extraction has failed", "check fan and filter")


def safety_silence_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.limits is not None and facts.safety_age_s > STALE_PERIODS * facts.limits.period_s:
        yield InterlockFinding(
            f"the safety inputs have not been read for {facts.safety_age_s:.1f} s",
            "check power and cable of the safety-input device")
