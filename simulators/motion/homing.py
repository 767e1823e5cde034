"""The homing cycle: seek the limit switches, Z first, then pull off.

The switches are at the end of travel: at 0, or at -travel where `$23` selects it. The seek for
each switch is one move, without the firmware's second, slower approach.
"""

from __future__ import annotations

from simulators.motion.actions import StraightMove, Vector
from simulators.motion.machine import MotionMachine
from simulators.motion.states import ControllerState
from simulators.motion.waits import Steps, WaitReason

_CLEARANCE_S = 0.5  # debounce and settling after each leg


def home_machine(machine: MotionMachine) -> Steps:
    """Home all axes and leave the machine Idle."""
    machine.state = ControllerState.HOME
    settings = machine.settings
    seek, leave = settings[25] / 60.0, settings[24] / 60.0
    x, y, _ = machine.planner.position_mm
    switch, clear = _ends(machine)
    there, off = (_as_believed(machine, place) for place in (switch, clear))
    for legs in (
        (StraightMove((x, y, there[2]), seek), StraightMove(there, seek)),
        (StraightMove(off, leave),),
    ):
        for leg in legs:
            machine.planner.add(leg)
        machine.stepper.start(machine.now_s)
        yield WaitReason.STANDSTILL
        yield machine.now_s + _CLEARANCE_S
    machine.stepper.running = False
    machine.set_position(clear, (0.0, 0.0, 0.0))
    machine.state = ControllerState.IDLE
    machine.alarm = 0
    machine.homed = True
    machine.reporter.on_homed_changed()
    return 0


def _as_believed(machine: MotionMachine, place_mm: Vector) -> Vector:
    """Convert a true position to the controller's coordinates before homing."""
    (x, y, z), (dx, dy, dz) = place_mm, machine.trace.position_error_mm
    return (x - dx, y - dy, z - dz)


def _ends(machine: MotionMachine) -> tuple[Vector, Vector]:
    """Positions of the switches, and of the axes after pull-off."""
    settings = machine.settings
    switch, clear = [], []
    for axis, travel in enumerate(settings.travel_mm):
        far = int(settings[23]) >> axis & 1
        switch.append(-travel if far else 0.0)
        clear.append(switch[axis] + (settings[27] if far else -settings[27]))
    return (switch[0], switch[1], switch[2]), (clear[0], clear[1], clear[2])
