"""Executes the actions of a line on the machine in order, waiting where an action requires it."""

from __future__ import annotations

from collections.abc import Iterable

from firmware_protocol.messages import FeedbackMessage
from simulators.motion.actions import (
    BEAM_CONSTANT,
    Action,
    Dwell,
    ProbeFailure,
    ProgramEnd,
    ProgramPause,
    ReadInput,
    SetCoolant,
    SetOutput,
    SetSpindle,
    StraightMove,
    ToolChange,
    Vector,
)
from simulators.motion.machine import MotionMachine
from simulators.motion.states import ControllerState
from simulators.motion.waits import Steps, WaitReason

PROBE_FAILURE_ALARM_CODE = 5


def perform_actions(machine: MotionMachine, actions: Iterable[Action]) -> Steps:
    """Perform every action in order. In check mode only targets are checked."""
    for action in actions:
        if isinstance(action, StraightMove):
            yield from _move(machine, action)
        elif machine.state is not ControllerState.CHECK:
            yield WaitReason.STANDSTILL
            yield from _at_rest(machine, action)
    return 0


def is_out_of_travel(machine: MotionMachine, target_mm: Vector) -> bool:
    """Soft limits ($20) are on and the target exceeds them; grblHAL checks only homed axes."""
    if not machine.settings[20] or (machine.hal and not machine.homed):
        return False
    travels = machine.settings.travel_mm
    return any(not -travel <= at <= 0.0 for at, travel in zip(target_mm, travels, strict=True))


def _move(machine: MotionMachine, motion: StraightMove) -> Steps:
    if is_out_of_travel(machine, motion.target_mm):
        machine.stop_for_soft_limit()
        yield WaitReason.NEVER
    if machine.state is ControllerState.CHECK:
        return 0
    yield WaitReason.PLANNER_ROOM
    planned = machine.planner.add(motion)
    if planned is None and motion.beam == BEAM_CONSTANT:
        # With M3 the beam is on at standstill: a zero-length move still sets the power
        yield WaitReason.STANDSTILL
        machine.stepper.set_standstill_power(motion.power, machine.now_s)
    return 0


def _at_rest(machine: MotionMachine, action: Action) -> Steps:
    match action:
        case SetSpindle(mode, standstill_power):
            machine.accessories.set_spindle(mode, standstill_power, machine.now_s)
        case SetCoolant(flood, mist):
            machine.accessories.set_coolant(flood, mist)
        case Dwell(seconds):
            yield machine.now_s + seconds
        case SetOutput(kind, port, value):
            machine.trace.outputs.append((machine.now_s, kind, port, value))
        case ReadInput(seconds, result):
            yield machine.now_s + seconds
            machine.input_result = result
            machine.reporter.on_input_read()
        case ProbeFailure(alarm):
            machine.probed_mm = machine.position_mm()
            x, y, z = machine.probed_mm
            machine.say(FeedbackMessage("PRB", f"{x:.3f},{y:.3f},{z:.3f}:0"))
            if alarm:
                machine.raise_alarm(PROBE_FAILURE_ALARM_CODE)
        case ProgramPause():
            machine.enter_hold()
            yield WaitReason.STANDSTILL
        case ToolChange():
            machine.state = ControllerState.TOOL
            machine.reporter.on_tool_requested()
        case ProgramEnd():
            machine.accessories.switch_all_off(machine.now_s)
            machine.set_overrides(100, 100, 100)
            machine.say(FeedbackMessage("MSG", "Pgm End"))
        case StraightMove():
            raise AssertionError("a motion does not wait for rest")
    return 0
