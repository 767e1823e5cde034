"""Carries out the actions of a line on the machine, one after the other, waiting where it must."""

from __future__ import annotations

from collections.abc import Iterable

from firmware_protocol.messages import Feedback
from simulators.motion.actions import (
    BEAM_CONSTANT,
    Action,
    Coolant,
    Dwell,
    Motion,
    Pause,
    Probe,
    ProgramEnd,
    ReadInput,
    Spindle,
    Switch,
    ToolChange,
    Vector,
)
from simulators.motion.machine import Machine
from simulators.motion.states import State
from simulators.motion.waits import Steps, Wait

PROBE_ALARM = 5


def perform(machine: Machine, actions: Iterable[Action]) -> Steps:
    """Every action in order. In check mode only targets are checked."""
    for action in actions:
        if isinstance(action, Motion):
            yield from _move(machine, action)
        elif machine.state is not State.CHECK:
            yield Wait.REST
            yield from _at_rest(machine, action)
    return 0


def out_of_travel(machine: Machine, target_mm: Vector) -> bool:
    """Soft limits ($20) are on and the target is beyond them; grblHAL only minds homed axes."""
    if not machine.settings[20] or (machine.hal and not machine.homed):
        return False
    travels = machine.settings.travel_mm
    return any(not -travel <= at <= 0.0 for at, travel in zip(target_mm, travels, strict=True))


def _move(machine: Machine, motion: Motion) -> Steps:
    if out_of_travel(machine, motion.target_mm):
        machine.soft_limit()
        yield Wait.NEVER
    if machine.state is State.CHECK:
        return 0
    yield Wait.ROOM
    planned = machine.planner.add(motion)
    if planned is None and motion.beam == BEAM_CONSTANT:
        yield Wait.REST  # M3 burns at standstill: a move of no length still sets the power
        machine.stepper.stand(motion.power, machine.now_s)
    return 0


def _at_rest(machine: Machine, action: Action) -> Steps:
    match action:
        case Spindle(mode, standing):
            machine.accessories.set_spindle(mode, standing, machine.now_s)
        case Coolant(flood, mist):
            machine.accessories.set_coolant(flood, mist)
        case Dwell(seconds):
            yield machine.now_s + seconds
        case Switch(kind, port, value):
            machine.trace.outputs.append((machine.now_s, kind, port, value))
        case ReadInput(seconds, result):
            yield machine.now_s + seconds
            machine.input_result = result
            machine.reporter.input_read()
        case Probe(alarm):
            machine.probed_mm = machine.position_mm()
            x, y, z = machine.probed_mm
            machine.say(Feedback("PRB", f"{x:.3f},{y:.3f},{z:.3f}:0"))
            if alarm:
                machine.raise_alarm(PROBE_ALARM)
        case Pause():
            machine.hold()
            yield Wait.REST
        case ToolChange():
            machine.state = State.TOOL
            machine.reporter.tool_requested()
        case ProgramEnd():
            machine.accessories.all_off(machine.now_s)
            machine.set_overrides(100, 100, 100)
            machine.say(Feedback("MSG", "Pgm End"))
        case Motion():
            raise AssertionError("a motion does not wait for rest")
    return 0
