"""Where deposition ended when motion was stopped: what is reported, and what is inferred.

Without a laser-enable output the beam is on until motion ends (M4), so the bead ends where the
nozzle stops. With one the beam goes off first, and motion runs on: then the bead ends where the
nozzle was at that moment, which the program clock gives. Where no report at standstill arrives,
the controller may have executed every line that it was sent.
"""

from __future__ import annotations

import math

from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.safety.driver import SafetyDriver
from lmctl.machine.safety.laser_enable import LASER_OFF_DELAY_S
from lmctl.machine.safety.status import SafetyStatus
from lmctl.run.interlocks.motion_rules import OFF_PATH_MM
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.place import Known, PlaceReached, ProgramPlace, known_place, unknown_place
from lmctl.run.program.program_clock import ProgramClock

#: Two places in a program that differ by less are the same [s of program time].
_SAME_S = 1e-3


def beam_off_s(safety: SafetyDriver | None, clock: ProgramClock, t: float) -> float:
    """Program time at which the beam goes off, when motion is commanded to stop at machine time t.

    inf where it stays on until motion ends. Where the safety circuit is open already, the beam was
    taken away at an unknown moment since the answer before: the earliest one counts, so that
    nothing is left out; up to one period of the safety device may be deposited twice.
    """
    status = None if safety is None else safety.status
    if safety is None or status is None:
        return math.inf
    if _is_open(status):
        since_s = max(0.0, t - (status.time_s - safety.period_s + LASER_OFF_DELAY_S))
        return clock.if_not_stopped(t) - since_s * clock.rate
    if status.laser_enabled is None:
        return math.inf
    return clock.if_not_stopped(t + LASER_OFF_DELAY_S)


def _is_open(status: SafetyStatus) -> bool:
    """Whether an open circuit switches the beam off at the laser itself."""
    return False in (
        status.estop_closed, status.door_closed, status.laser_ready, status.key_on,
        status.relay_closed, status.laser_enabled,
    )


def deposition_end(
    motion: MotionDriver, clock: ProgramClock, window: JobWindow, *, executed_s: float,
    off_s: float, sent: int, reported_s: float | None,
) -> PlaceReached:
    """Where deposition ended, now that no more lines are sent.

    executed_s : program time up to which bead has been deposited for certain, by the reports
    off_s : program time at which the beam went off before motion ended, inf if it did not
    sent : the last line that may have been sent
    reported_s : machine time of the last report on the path
    """
    on_path = clock.off_mm <= OFF_PATH_MM and not clock.is_in_doubt
    if is_at_rest(motion):
        if motion.position_trusted and not on_path:
            return known_place(place_at(window, executed_s), Known.INFERRED, reported_s)
        if on_path and (motion.position_trusted or not _at_zero(motion)):
            sure = motion.position_trusted and executed_s <= off_s + _SAME_S
            ended = place_at(window, min(executed_s, off_s))
            return known_place(ended, Known.REPORTED if sure else Known.INFERRED, reported_s)
    proven = place_at(window, min(executed_s, off_s))
    sent_s = window.line_start_s(sent + 1)
    if off_s < math.inf and on_path and not motion.restarted:
        likely = max(proven, place_at(window, min(off_s, sent_s)))
        return PlaceReached(likely, Known.INFERRED, proven, likely, reported_s)
    return unknown_place(proven, place_at(window, min(sent_s, off_s)), reported_s)


def is_at_rest(motion: MotionDriver) -> bool:
    """Whether the controller reports, and has reported that the machine is at rest."""
    report = motion.status
    return motion.lost is None and report is not None and (
        report.is_held or report.state in ("Idle", "Alarm")
    )


def place_at(window: JobWindow, s: float) -> ProgramPlace:
    """The place in the job that belongs to a program time."""
    line = window.line_at_program_time(s)
    start_s, end_s = window.line_start_s(line), window.line_start_s(line + 1)
    share = (s - start_s) / (end_s - start_s) if end_s > start_s else 0.0
    return ProgramPlace(line, min(max(share, 0.0), 1.0))


def _at_zero(motion: MotionDriver) -> bool:
    """Whether the controller reports the position that every controller has after power-on."""
    report = motion.status
    where = None if report is None else report.machine_mm
    return where is None or not any(where)
