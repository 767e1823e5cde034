"""The machine behind the interpreter: motion, beam, coolant and doors, and the states they are in.

Real-time commands act here. Time passes by `settle`: whatever has ended by then (a motion, a hold,
a jog's cancellation) changes the state as the firmware's cycle-stop flag does. What the firmware
would say meanwhile goes to `say`.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.messages import Alarm, Feedback, Message
from simulators.motion.accessories import Accessories
from simulators.motion.actions import Vector
from simulators.motion.planner import Planner
from simulators.motion.reports import StatusReporter
from simulators.motion.settings import Settings
from simulators.motion.states import MOVING, State
from simulators.motion.stepper import Stepper
from simulators.motion.trace import Trace

HARD_LIMIT_ALARM, SOFT_LIMIT_ALARM, ABORTED_ALARM, HOMING_ALARM, ESTOP_ALARM = 1, 2, 3, 6, 10
_CRITICAL = frozenset((HARD_LIMIT_ALARM, SOFT_LIMIT_ALARM, ESTOP_ALARM))

_ORIGIN: Vector = (0.0, 0.0, 0.0)
# How far the step segment buffer runs ahead: of 10 ms each, Grbl keeps 5 ready and grblHAL 9.
_SEGMENT_S = 0.01
_SEGMENTS = {False: 5, True: 9}


class Stopping(Enum):
    """Why the axes are braking."""

    HOLD = "hold"
    DOOR = "door"
    JOG_CANCEL = "jog cancel"
    SOFT_LIMIT = "soft limit"


class Machine:
    """State and motion of one controller. Times are seconds on the loop's clock."""

    def __init__(
        self,
        dialect: Dialect,
        settings: Settings,
        planner_blocks: int,
        say: Callable[[Message], None],
        displaced: Callable[[Vector], None],
    ) -> None:
        self.hal = dialect is GRBLHAL
        self.settings = settings
        self.say = say
        self._displaced = displaced
        self.state = State.IDLE
        self.alarm = 0
        self.critical = False
        self.stopping: Stopping | None = None
        self.restore_s: float | None = None  # when a closed door lets motion go on
        self.homed = False
        self.door_open = False
        self.estop_open = False
        self.overrides = (100, 100, 100)
        self.probed_mm = _ORIGIN
        self.input_result: int | None = None
        self.now_s = 0.0
        self.trace = Trace(_ORIGIN)
        self.planner = Planner(planner_blocks, settings.kinematics())
        segments = _SEGMENTS[self.hal]
        self.stepper = Stepper(self.planner, self.trace, segments * _SEGMENT_S, segments)
        self.reporter = StatusReporter(dialect)
        self.accessories = Accessories(settings, self.stepper, self.reporter, self.hal)
        self._door_after_jog = False

    def settle(self, now_s: float) -> None:
        """Let time pass to now_s."""
        self.now_s = now_s
        stepper = self.stepper
        stepper.advance(now_s)
        if self.stopping is not None:
            if stepper.stopped(now_s):
                self._has_stopped()
        elif self.state in MOVING:
            if self.state is not State.HOME and stepper.stopped(now_s):
                stepper.running = False
                self.state = State.IDLE
        elif self.restore_s is not None and now_s >= self.restore_s:
            self._go_on()

    def start(self) -> None:
        """Execute what is planned, if the state allows it (the firmware's auto cycle start)."""
        if self.state is State.IDLE and self.planner.first is not None:
            self.state = State.RUN
            self.stepper.start(self.now_s)

    def at_rest(self) -> bool:
        """All motion has been executed."""
        return self.planner.first is None and self.stepper.stopped(self.now_s)

    def held(self) -> bool:
        """A hold or door stop is complete."""
        return self.state in (State.HOLD, State.DOOR) and self.stopping is None

    def next_event_s(self) -> float:
        """When planned motion next changes something without further input."""
        return self.stepper.next_event_s()

    def position_mm(self) -> Vector:
        """Where the axes are, in whole steps."""
        x, y, z = self.stepper.position_mm(self.now_s)
        sx, sy, sz = self.planner.kinematics.steps_per_mm
        return (round(x * sx) / sx, round(y * sy) / sy, round(z * sz) / sz)

    # --- real-time commands

    def hold(self) -> None:
        if self.state is State.JOG:
            self.cancel_jog()
        elif self.state in (State.RUN, State.IDLE):
            self._brake(Stopping.HOLD)
            self.state = State.HOLD
            self._stopped_at_once()

    def door(self) -> None:
        """Stop for the safety door: axes, then beam and coolant."""
        if self.state in (State.ALARM, State.CHECK, State.SLEEP, State.HOME, State.TOOL):
            return
        if self.hal and self.state is State.DOOR:
            return
        self.say(Feedback("MSG", "Check Door"))
        self.restore_s = None
        if self.state is State.JOG:
            self.cancel_jog()
            self._door_after_jog = True
            return
        if self.stopping is None:
            self._brake(Stopping.DOOR)
        self.stopping = Stopping.DOOR
        self.state = State.DOOR
        self._stopped_at_once()

    def cancel_jog(self) -> None:
        if self.state is State.JOG and self.stopping is None:
            self._brake(Stopping.JOG_CANCEL)

    def soft_limit(self) -> None:
        """A target outside the travel: come to rest, then lock."""
        if self.state is State.RUN:
            self.state = State.HOLD
        self._brake(Stopping.SOFT_LIMIT)
        self._stopped_at_once()

    def resume(self) -> None:
        if self.state is State.HOLD and self.stopping is None:
            if self.accessories.spindle_stopped:
                self.say(Feedback("MSG", "Restoring spindle"))
            if self.hal:
                self.say(Feedback("MSG", ""))
            self._go_on()
        elif self.state is State.DOOR and self.held() and not self.door_open:
            if self.restore_s is None:
                self.restore_s = self.now_s + self.accessories.restore_delay_s()
                self.settle(self.now_s)
        elif self.state is State.TOOL:
            self.state = State.IDLE
            self.start()

    def toggle_spindle_stop(self) -> None:
        if self.state is not State.HOLD or self.stopping is not None:
            return
        if self.accessories.spindle_stopped:
            self.say(Feedback("MSG", "Restoring spindle"))
            self.accessories.restore_spindle(self.now_s)
        else:
            self.accessories.stop_spindle()

    def toggle_coolant(self, mist: bool) -> None:
        if self.state in (State.IDLE, State.RUN, State.HOLD):
            on = self.accessories
            on.set_coolant(on.flood != (not mist), on.mist != mist)

    def set_overrides(self, feed: int, rapid: int, spindle: int) -> None:
        """Percent; clipped to what the firmware allows."""
        wanted = (min(200, max(10, feed)), rapid, min(200, max(10, spindle)))
        if wanted == self.overrides:
            return
        self.overrides = wanted
        self.stepper.set_overrides(
            wanted[0] / 100.0, wanted[1] / 100.0, wanted[2] / 100.0, self.now_s
        )
        self.reporter.overrides_changed()

    def reset(self) -> int:
        """Everything off and forgotten; position kept. Returns the alarm it earns, or 0."""
        moving = self.state in MOVING or self.stopping is not None
        homing = self.state is State.HOME
        locked = self.state is State.ALARM or (self.state is State.SLEEP)
        self._stop_dead()
        self.critical = self.estop_open and self.hal
        self._door_after_jog = False
        self.accessories.all_off(self.now_s)
        self.set_overrides(100, 100, 100)
        self.reporter.restart()
        alarm = 0
        if self.critical:
            alarm = ESTOP_ALARM
        elif homing:
            alarm = HOMING_ALARM
        elif moving and not self.hal:
            alarm = ABORTED_ALARM
        self.alarm = alarm or (self.alarm if locked else 0)
        self.state = State.ALARM if alarm or locked else State.IDLE
        if alarm:
            self.homed = False
        return alarm

    def stop_keeping_state(self) -> None:
        """grblHAL's 0x19: stop dead, forget the plan, keep position and offsets."""
        self._stop_dead()
        self.accessories.all_off(self.now_s)
        if self.state is not State.ALARM:
            self.state = State.IDLE

    def halt(self, code: int) -> None:
        """A limit switch or the e-stop input: motion and beam end at once, wherever they are."""
        if code != ESTOP_ALARM or self.state in MOVING or self.stopping is not None:
            self.homed = False
        self._stop_dead()
        self._door_after_jog = False
        self.raise_alarm(code)

    def lose_power(self) -> None:
        """Everything is forgotten but the settings; axes stand where they are, at 0, 0, 0."""
        self._stop_dead()
        self.critical = self.homed = self._door_after_jog = False
        self.accessories.all_off(self.now_s)
        self.set_overrides(100, 100, 100)
        self.reporter.restart()
        self.alarm = 0
        self.state = State.IDLE
        (x, y, z), (dx, dy, dz) = self.trace.position_at(self.now_s), self.trace.shift_mm
        self.take_position(_ORIGIN, (x + dx, y + dy, z + dz))

    def take_position(self, believed_mm: Vector, shift_mm: Vector) -> None:
        """Standing still, take the axes to be elsewhere. shift_mm : truth less belief"""
        self.trace.rebase(self.now_s, believed_mm, shift_mm)
        self.planner.clear(believed_mm)
        self._displaced(believed_mm)

    def raise_alarm(self, code: int) -> None:
        """Lock. Limits and e-stop stay locked until a reset."""
        self.alarm = code
        self.state = State.ALARM
        self.say(Alarm(code))
        self.accessories.all_off(self.now_s)
        if code in _CRITICAL:
            self.critical = True
            text = "Emergency stop - clear, then reset" if code == ESTOP_ALARM else "Reset"
            self.say(Feedback("MSG", f"{text} to continue"))

    def _stop_dead(self) -> None:
        self.stepper.stop_dead(self.now_s)
        self.stopping = self.restore_s = None
        self._displaced(self.planner.position_mm)

    def _brake(self, why: Stopping) -> None:
        self.stopping = why
        self.stepper.hold(self.now_s)

    def _stopped_at_once(self) -> None:
        if self.stopping is not None and self.stepper.stopped(self.now_s):
            self._has_stopped()

    def _has_stopped(self) -> None:
        why, self.stopping = self.stopping, None
        if why is Stopping.HOLD:
            if self.settings.laser and self.settings.laser_off_in_hold:
                self.accessories.stop_spindle()
        elif why is Stopping.DOOR:
            self.accessories.stop_for_door()
        else:
            self.stepper.forget(self.now_s)
            self._displaced(self.planner.position_mm)
            if why is Stopping.SOFT_LIMIT:
                self.raise_alarm(SOFT_LIMIT_ALARM)
            elif self._door_after_jog:
                self._door_after_jog = False
                self.state = State.DOOR
            else:
                self.state = State.IDLE

    def _go_on(self) -> None:
        self.restore_s = None
        self.accessories.restore(self.now_s)
        self.state = State.IDLE
        if self.planner.first is not None:
            self.state = State.RUN
            self.stepper.start(self.now_s)
