"""The state of the machine at one instant, as its status report gives it."""

from __future__ import annotations

from simulators.motion.actions import Vector
from simulators.motion.machine import MotionMachine
from simulators.motion.reports import ReportFields
from simulators.motion.states import MOVING_STATES, ControllerState


def report_fields(machine: MotionMachine, offset_mm: Vector, tool: int,
                  rx_free: int) -> ReportFields:
    """offset_mm, tool, rx_free : values that the machine itself does not hold"""
    feed_mm_min, speed = _feed_and_speed(machine)
    return ReportFields(
        state=machine.state,
        substate=_substate(machine),
        position_mm=machine.position_mm(),
        offset_mm=offset_mm,
        blocks_free=machine.planner.capacity - machine.planner.count,
        rx_free=rx_free,
        line=machine.stepper.last_line,
        feed_mm_min=feed_mm_min,
        speed=speed,
        overrides=machine.overrides,
        accessories=machine.accessories.letters(),
        pins=_pins(machine),
        homed=machine.homed,
        tool=tool,
        input_result=machine.input_result,
    )


def _pins(machine: MotionMachine) -> str:
    """Letters of the inputs that are active; the e-stop of Grbl is its reset input."""
    pins = "D" if machine.door_open else ""
    if machine.estop_open:
        pins += "E" if machine.hal else "R"
    return pins


def _substate(machine: MotionMachine) -> int | None:
    """The substate number of Hold and Door."""
    if machine.state is ControllerState.HOLD:
        return 0 if machine.stopping is None else 1
    if machine.state is ControllerState.DOOR:
        if machine.stopping is not None:
            return 2
        return 3 if machine.restore_s is not None else int(machine.door_open)
    return None


def _feed_and_speed(machine: MotionMachine) -> tuple[float, float]:
    """Actual feed [mm/min] and S at the head of the committed motion, as the firmware reports."""
    speed, power = machine.stepper.reported_speed_and_power()
    block = machine.stepper.block
    if machine.hal and machine.is_held() and block is not None:
        speed = block.nominal_speed  # grblHAL reports the speed it will resume with
    elif machine.state not in MOVING_STATES and machine.stopping is None:
        speed = 0.0
    return speed * 60.0, power * machine.settings[30]
