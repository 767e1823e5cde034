"""The interlock table (process.md 5.4) as data: what is looked at, for how long, and the answer.

Pure: rules look at facts that carry their own ages. A stale input is a tripped input.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from firmware_protocol.status import StatusReport
from lmctl.config.machine import Hopper, Safety
from lmctl.machine.feeder.status import FeederStatus, HopperReading
from lmctl.machine.safety.status import SafetyStatus

#: Reports missing before a device counts as silent (process.md 5.3).
STALE_PERIODS = 3

#: A machine that says it runs must move within so much [s]: at the slowest bead it does.
_STILL_S = 1.0

#: A controller follows its lines to a step, and rounding of reports leaves 0.005 mm. Farther off
#: than this, what it runs is not what was sent: G-code has no checksum.
OFF_PATH_MM = 0.3

#: The controller holds by itself; a relay that has just closed shows in its next report only.
_DOOR_S = 0.5
_CLOSE_IT = "close it; look at the part, then resume"

_SHIELD_GAS_S, _CARRIER_GAS_S, _DISC_S, _WEIGHED_S = 0.5, 1.0, 2.0, 20.0
_CARRIER_SHARE = 0.8
_DISC_SHARE, _DISC_LEAST_G_MIN = 0.02, 0.05
_WEIGHED_SHARE, _WEIGHED_LEAST_G_MIN = 0.15, 0.5


class Reaction(Enum):
    """What the run does about it."""

    HOLD = "hold: beam and motion down, then powder; gas stays"
    RESET = "reset the controller at once; powder, then gas off"
    PATH_END = "hold as soon as the beam is off by the program"


class FeederFacts(NamedTuple):
    """How old a feeder's last good answer is, and what it said of hoppers: see `settled`."""

    name: str
    age_s: float
    period_s: float
    hoppers: Sequence[tuple[Hopper, HopperReading]]


class Facts(NamedTuple):
    """All a rule may look at.

    still_s : for how long the controller has said that it runs the program without moving, the
        program's own waits left out
    off_path_mm : how far the place last reported is from the program's path; 0 where none runs
    safety, limits : None where the cell has no safety-input device
    """

    motion: StatusReport | None
    still_s: float
    off_path_mm: float
    motion_age_s: float
    motion_period_s: float
    feeders: Sequence[FeederFacts]
    safety: SafetyStatus | None
    safety_age_s: float
    limits: Safety | None


@dataclass(frozen=True)
class Finding:
    """What a rule has found. subject : which of several like things, or ""."""

    what: str
    hint: str
    subject: str = ""


@dataclass(frozen=True)
class Rule:
    """One row of the table.

    for_s : how long it must be so before anything is done
    latched : it stands until an operator acknowledges it, and so does not keep one from that
    of_safety : only the safety-input device says so; without one there is nothing to look at
    """

    name: str
    look: Callable[[Facts], Iterator[Finding]]
    reaction: Reaction = Reaction.HOLD
    for_s: float = 0.0
    latched: bool = False
    of_safety: bool = False


def _estop(facts: Facts) -> Iterator[Finding]:
    if facts.safety is not None and facts.safety.estop_closed is False:
        yield Finding("the emergency stop chain is open",
                      "release the emergency stop, reset the safety circuit, home the machine")


def _door(facts: Facts) -> Iterator[Finding]:
    if facts.safety is not None and facts.safety.door_closed is False:
        yield Finding("the safety door is open", _CLOSE_IT)


def _controllers_door(facts: Facts) -> Iterator[Finding]:
    """The controller's own door input, where it is not the watchdog relay that opens it."""
    safety, report = facts.safety, facts.motion
    by_relay = safety is not None and safety.relay_closed is False
    # Door:0 is what a controller says once it is closed again, until it is told to go on.
    if report is not None and report.state == "Door" and report.substate != 0 and not by_relay:
        yield Finding("the safety door is open, says the motion controller", _CLOSE_IT)


def _laser(facts: Facts) -> Iterator[Finding]:
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
            yield Finding(what, hint, what)


def _chiller(facts: Facts) -> Iterator[Finding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    if safety.chiller_ok is False:
        yield Finding("the chiller does not cool", "check its flow, level and fault display")
    else:
        yield from _beyond("the chiller flows at", safety.chiller_L_min, "L/min",
                           "check its pump and level", least=limits.chiller_min_L_min)
        yield from _beyond("the chiller is at", safety.chiller_C, "°C", "let it cool down",
                           most=limits.chiller_max_C)


def _shield_gas(facts: Facts) -> Iterator[Finding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    hint = "check bottle, regulator and valve"
    if safety.shield_gas_ok is False:
        yield Finding("shield gas is missing", hint)
    else:
        yield from _beyond("shield gas flows at", safety.shield_gas_L_min, "L/min", hint,
                           least=limits.shield_gas_min_L_min)


def _oxygen(facts: Facts) -> Iterator[Finding]:
    safety, limits = facts.safety, facts.limits
    if safety is None or limits is None:
        return
    if safety.oxygen_valid is False:
        yield Finding("the oxygen analyser gives no valid reading",
                      "check it; what it does not see counts as too much", "analyser")
    else:
        yield from _beyond("oxygen is at", safety.oxygen_ppm, "ppm", "purge the chamber",
                           most=limits.oxygen_trip_ppm)


def _beyond(
    what: str, value: float | None, unit: str, hint: str, *, least: float | None = None,
    most: float | None = None,
) -> Iterator[Finding]:
    """A value below its least or above its most; one that is unknown is both."""
    said = "an unknown value" if value is None else f"{value:g} {unit}"
    if least is not None and (value is None or value < least):
        yield Finding(f"{what} {said}, {least:g} {unit} is needed", hint)
    if most is not None and (value is None or value > most):
        yield Finding(f"{what} {said}, {most:g} {unit} is allowed", hint)


def _relay(facts: Facts) -> Iterator[Finding]:
    if facts.safety is not None and facts.safety.relay_closed is False:
        yield Finding("the watchdog relay is open", "find out why heartbeats stopped")


def _extraction(facts: Facts) -> Iterator[Finding]:
    if facts.safety is not None and facts.safety.extraction_ok is False:
        yield Finding("extraction has failed", "check fan and filter")


def _safety_silent(facts: Facts) -> Iterator[Finding]:
    if facts.limits is not None and facts.safety_age_s > STALE_PERIODS * facts.limits.period_s:
        yield Finding(f"the safety inputs have not been read for {facts.safety_age_s:.1f} s",
                      "check power and cable of the safety-input device")


def _motion_silent(facts: Facts) -> Iterator[Finding]:
    if facts.motion_age_s > STALE_PERIODS * facts.motion_period_s:
        yield Finding(f"the motion controller has not reported for {facts.motion_age_s:.1f} s",
                      "check its cable; if the beam is still on, use the emergency stop")


def _not_following(facts: Facts) -> Iterator[Finding]:
    if facts.still_s > _STILL_S:
        yield Finding(
            f"the motion controller says it runs, but its position has not changed for "
            f"{facts.still_s:.1f} s",
            "its reports cannot be relied on: reset it, home the machine",
        )


def _off_path(facts: Facts) -> Iterator[Finding]:
    if facts.off_path_mm > OFF_PATH_MM:
        yield Finding(
            f"the nozzle is {facts.off_path_mm:.1f} mm off the programmed path, says the motion "
            "controller",
            "a line, or the reports, were damaged on their way: look at the part, and at cable and "
            "earthing of the controller, then resume",
        )


def _feeder_silent(facts: Facts) -> Iterator[Finding]:
    for feeder in facts.feeders:
        if feeder.age_s > STALE_PERIODS * feeder.period_s:
            yield Finding(f"feeder {feeder.name}: no answer for {feeder.age_s:.1f} s",
                          "check its power and cable", feeder.name)


def _carrier_gas(facts: Facts) -> Iterator[Finding]:
    for feeder in facts.feeders:
        for hopper, reading in feeder.hoppers:
            flow, wanted = reading.carrier_L_min, hopper.carrier_L_min
            if flow is not None and flow < _CARRIER_SHARE * wanted:
                yield Finding(
                    f"hopper {hopper.name}: carrier gas flows at {flow:.1f} L/min, "
                    f"{wanted:g} L/min is set",
                    f"check gas supply and hose of feeder {feeder.name}", hopper.name,
                )


def _disc(facts: Facts) -> Iterator[Finding]:
    for feeder in facts.feeders:
        for hopper, reading in feeder.hoppers:
            flow, wanted = reading.flow_est_g_min, reading.setpoint_g_min
            if _is_off(flow, wanted, _DISC_LEAST_G_MIN, _DISC_SHARE):
                yield Finding(
                    f"hopper {hopper.name}: its disc feeds {flow:.2f} g/min, {wanted:.2f} g/min "
                    f"is set",
                    f"look whether the disc of feeder {feeder.name} is jammed", hopper.name,
                )


def _weighed(facts: Facts) -> Iterator[Finding]:
    for feeder in facts.feeders:
        for hopper, reading in feeder.hoppers:
            weighed, wanted = reading.flow_weighed_g_min, reading.setpoint_g_min
            if _is_off(weighed, wanted, _WEIGHED_LEAST_G_MIN, _WEIGHED_SHARE):
                yield Finding(
                    f"hopper {hopper.name}: by weight it loses {weighed:.2f} g/min, "
                    f"{wanted:.2f} g/min is set",
                    f"look whether powder moves in feeder {feeder.name}", hopper.name,
                )


def _is_off(flow: float | None, wanted: float, least: float, share: float) -> bool:
    """Whether a flow that is known differs by more than a share, and more than the least."""
    return flow is not None and abs(flow - wanted) > max(least, share * wanted)


def settled(
    status: FeederStatus | None, hoppers: Iterable[Hopper]
) -> tuple[tuple[Hopper, HopperReading], ...]:
    """Those of a feeder's hoppers whose powder runs and has settled, with what was read of them."""
    if status is None or not (status.feeding and status.stable):
        return ()
    return tuple(
        (hopper, status.hoppers[hopper.name]) for hopper in hoppers if hopper.name in status.hoppers
    )


#: The first row that holds is the first alarm, where several hold at once.
RULES: tuple[Rule, ...] = (
    Rule("emergency stop", _estop, Reaction.RESET, of_safety=True),
    Rule("door", _door, of_safety=True),
    Rule("controller's door", _controllers_door, for_s=_DOOR_S),
    Rule("laser", _laser, of_safety=True),
    Rule("chiller", _chiller, of_safety=True),
    Rule("shield gas", _shield_gas, for_s=_SHIELD_GAS_S, of_safety=True),
    Rule("oxygen", _oxygen, of_safety=True),
    Rule("safety inputs silent", _safety_silent, of_safety=True),
    Rule("watchdog relay", _relay, latched=True, of_safety=True),
    Rule("motion silent", _motion_silent),
    Rule("position", _not_following, Reaction.RESET),
    Rule("path", _off_path),
    Rule("feeder silent", _feeder_silent),
    Rule("carrier gas", _carrier_gas, for_s=_CARRIER_GAS_S),
    Rule("disc", _disc, for_s=_DISC_S),
    Rule("weighed flow", _weighed, for_s=_WEIGHED_S),
    Rule("extraction", _extraction, Reaction.PATH_END, of_safety=True),
)

#: The same for a cell without a safety-input device.
RULES_WITHOUT_SAFETY = tuple(rule for rule in RULES if not rule.of_safety)
