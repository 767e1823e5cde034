"""Rules about what the motion controller reports about itself and the nozzle position."""

from __future__ import annotations

from collections.abc import Iterator

from lmctl.run.interlocks.cell_rules import CLOSE_AND_RESUME_HINT
from lmctl.run.interlocks.inputs import STALE_PERIODS, InterlockInputs
from lmctl.run.interlocks.rule import InterlockFinding

#: A machine that reports Run must move within this time [s]: at the slowest bead it does.
_STILL_S = 1.0

#: A controller follows its lines to a step, and rounding of reports leaves 0.005 mm. Farther off
#: than this, what it runs is not what was sent: G-code has no checksum.
OFF_PATH_MM = 0.1

#: Planned and real motion differ by 0.1 s at most from one report to the next. A place reached this
#: much too soon means a wait was skipped. A 200 % override may be reported one report late, and
#: gains that time.
_EARLY_S, _UNTOLD_PERIODS = 1.0, 2

_ROUNDING_S = 1e-6

#: A nozzle leaves its path only in motion; off the path and at rest, its report is wrong [s].
_FROZEN_S = 0.15
_FROZEN = "its reports cannot be relied on: reset it, home the machine"

_DAMAGED = (
    "a line, or the reports, were damaged on their way: look at the part, and at cable and "
    "earthing of the controller, then resume"
)


def controller_door_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    """The controller's own door input, where it is not the watchdog relay that opens it."""
    safety, report = facts.safety, facts.motion
    by_relay = safety is not None and safety.relay_closed is False
    # A controller reports Door:0 once the door is closed again, until it is commanded to resume.
    if report is not None and report.state == "Door" and report.substate != 0 and not by_relay:
        yield InterlockFinding("the safety door is open, says the motion controller",
                               CLOSE_AND_RESUME_HINT)


def motion_silence_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    """No plausible report for three periods, in which the host queries ten times or more."""
    stale = facts.motion_age_s >= STALE_PERIODS * facts.motion_period_s - _ROUNDING_S
    if not (stale and facts.motion_unanswered):
        return
    if facts.motion_unreadable:
        yield InterlockFinding(
            f"the motion controller's reports have been unreadable for {facts.motion_age_s:.1f} s",
            "the link is disturbed: check cable, earthing and baud rate of the controller; if the "
            "beam is still on, use the emergency stop",
        )
    else:
        yield InterlockFinding(
            f"the motion controller has not reported for {facts.motion_age_s:.1f} s",
            "check its cable; if the beam is still on, use the emergency stop")


def standstill_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.standstill_s > _STILL_S:
        yield InterlockFinding(
            f"the motion controller says it runs, but its position has not changed for "
            f"{facts.standstill_s:.1f} s",
            _FROZEN,
        )


def off_path_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    off_mm = facts.deviation.path_error_mm
    if off_mm > OFF_PATH_MM and facts.standstill_s > _FROZEN_S:
        yield InterlockFinding(
            f"the motion controller says it runs, but its position has not changed for "
            f"{facts.standstill_s:.1f} s, and is {off_mm:.1f} mm off the programmed path", _FROZEN,
        )
    elif facts.deviation.path_error_mm > OFF_PATH_MM:
        yield InterlockFinding(
            f"the nozzle is {facts.deviation.path_error_mm:.1f} mm off the programmed path, "
            "says the motion controller", _DAMAGED,
        )


def ahead_of_program_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    if facts.deviation.ahead_of_program_s > _EARLY_S + _UNTOLD_PERIODS * facts.motion_period_s:
        yield InterlockFinding(
            f"the nozzle is {facts.deviation.ahead_of_program_s:.1f} s ahead of the program: "
            "a wait was cut short", _DAMAGED,
        )


def uncommanded_output_findings(facts: InterlockInputs) -> Iterator[InterlockFinding]:
    said = facts.deviation.uncommanded_output
    if said is None:
        return
    asked = "no beam here"
    if any(said.commanded_powers_W):
        asked = " or ".join(
            f"{power_W:.0f}" for power_W in said.commanded_powers_W) + " W at that speed"
    if said.max_speed_mm_s > 0.0:
        asked += f", and {said.max_speed_mm_s:.1f} mm/s at most"
    yield InterlockFinding(
        f"the nozzle moves at {said.speed_mm_s:.1f} mm/s with {said.power_W:.0f} W of beam, says "
        f"the motion controller; the program asks for {asked}",
        _DAMAGED,
    )
