"""What a run requires of the motion controller before anything moves.

The machine position must have been confirmed. With homing enabled ($22) the homing cycle confirms
it: this session's own, or one that grblHAL still reports (`H:1`). Without homing the operator
confirms it by zeroing the axes or setting the work offset. An alarm or a reset in motion revokes
that until the controller is unlocked, by which the operator confirms the position again.
"""

from __future__ import annotations

from collections.abc import Iterator

from firmware_protocol.codes import alarm_meaning
from firmware_protocol.status import StatusReport
from lmctl.config.machine import MachineProfile
from lmctl.machine.manual.inspect_motion import MotionReading
from lmctl.machine.motion.identity import is_homing_enabled
from lmctl.run.cell.condition import StartCondition
from lmctl.run.cell.setting_conditions import setting_conditions
from lmctl.run.cell.work_offset import work_offset_conditions

#: States in which a run waits a moment for the machine to stop, and then is refused.
_MOVING = ("Run", "Jog", "Home")

#: How a position is given back to a controller without homing.
TOUCH_OFF = ("touch off: bring the nozzle to a known point of the part with `lmctl machine jog "
             "--relative`, and say where that is with `lmctl machine offset --here X.. Y.. Z..`")

_FIND_OUT = "find the reason, then `lmctl machine home` or `lmctl machine unlock`"


def can_read_door_and_estop(profile: MachineProfile) -> bool:
    """Whether the cell's door and emergency stop can be read: without that a beam stays off."""
    return profile.safety is not None and {"estop", "door"} <= set(profile.safety.fitted)


def motion_conditions(reading: MotionReading, profile: MachineProfile) -> Iterator[StartCondition]:
    """Every condition that can be judged in the state the controller is in."""
    identity = reading.identity
    if identity is None:
        yield _unreadable_state(reading.report, profile)
        return
    yield StartCondition(True, f"{identity.dialect.name} {identity.version} answers"
                          + (" (the bench)" if identity.is_bench else ""))
    if not identity.is_bench:
        yield StartCondition(can_read_door_and_estop(profile), "door and emergency stop are read"
                             if can_read_door_and_estop(profile) else
                             "the profile reads no door and no emergency stop: the beam stays off "
                             "in every run (S0)",
                             'add [safety] with "door" and "estop" fitted to the machine profile')
    yield StartCondition(not reading.damaged_message_count,
                         f"link: {reading.damaged_message_count} damaged messages",
                         "check cable, shielding and baud rate")
    yield _state(reading)
    if reading.report.state == "Idle":
        yield _position_known(reading)
    if not reading.settings:
        yield StartCondition(False, "it does not report its settings",
                             "clear its alarm, then try again",
                             refuses_run=True)
        return
    yield from setting_conditions(identity, reading.settings, reading.offset_mm, profile)
    yield from work_offset_conditions(reading.parser_state, reading.offsets)


def _position_known(reading: MotionReading) -> StartCondition:
    if reading.is_position_trusted:
        return StartCondition(True, "position is known", "", refuses_run=True)
    if is_homing_enabled(reading.settings):
        return StartCondition(False, "the machine has not been homed: its position is unknown",
                              "`lmctl machine home`", refuses_run=True)
    doubt = f": {reading.position_doubt}" if reading.position_doubt else ""
    return StartCondition(False, f"the controller has lost its place{doubt}", TOUCH_OFF,
                          refuses_run=True)


def _unreadable_state(report: StatusReport, profile: MachineProfile) -> StartCondition:
    """A controller that answers nothing but `?` in the state it is in."""
    state = report.state
    text = f"it is in state {state}: its settings cannot be read"
    if state == "Door" and report.substate != 0:
        relay = profile.safety is not None and profile.safety.relay_timeout_s is not None
        if not relay:
            return StartCondition(False, text, "close the door", refuses_run=True)
        return StartCondition(
            False, text, "close the door; with the door closed it is the watchdog relay, which is "
            "open while no host sends heartbeats: `lmctl machine doctor --close-relay` closes it "
            "as a run does, and checks the settings too",
        )
    if state in _MOVING:
        return StartCondition(False, text, "wait until it has stopped, then try again",
                              refuses_run=True)
    return StartCondition(False, f"{text}; a run would reset it, which keeps the position",
                          "end that state at its panel, then try again, to see the settings too")


def _state(reading: MotionReading) -> StartCondition:
    report, identity = reading.report, reading.identity
    if report.state != "Alarm" or identity is None:
        return StartCondition(report.state == "Idle", f"state {report.state}", _FIND_OUT,
                              refuses_run=reading.is_taken_over or report.state in _MOVING)
    if report.substate is None:
        return StartCondition(False, "it is locked by an alarm", _FIND_OUT, refuses_run=True)
    meaning = alarm_meaning(report.substate, identity.dialect)
    return StartCondition(False, f"alarm {report.substate}: {meaning.description}", meaning.remedy,
                          refuses_run=True)
