"""The machine behind the interpreter: motion, beam, coolant, doors and their states.

Real-time commands act here. `advance_to` lets time pass: when a motion, a hold or a jog cancel has
ended, the state changes as with the firmware's cycle-stop flag. Messages that the firmware would
send go to `say`.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.messages import AlarmMessage, FeedbackMessage, Message
from simulators.motion.accessories import Accessories
from simulators.motion.actions import Vector
from simulators.motion.planner import LookAheadPlanner
from simulators.motion.reports import StatusReporter
from simulators.motion.settings import FirmwareSettings
from simulators.motion.states import MOVING_STATES, ControllerState
from simulators.motion.stepper import Stepper
from simulators.motion.trace import MotionTrace

HARD_LIMIT_ALARM, SOFT_LIMIT_ALARM, ABORTED_ALARM, HOMING_ALARM, ESTOP_ALARM = 1, 2, 3, 6, 10
_CRITICAL = frozenset((HARD_LIMIT_ALARM, SOFT_LIMIT_ALARM, ESTOP_ALARM))

_ORIGIN: Vector = (0.0, 0.0, 0.0)
# Lead of the step segment buffer: Grbl keeps 5 segments of 10 ms ready, grblHAL 9.
_SEGMENT_S = 0.01
_SEGMENTS = {False: 5, True: 9}


class StopReason(Enum):
    """Why the axes are braking."""

    HOLD = "hold"
    DOOR = "door"
    JOG_CANCEL = "jog cancel"
    SOFT_LIMIT = "soft limit"


class MotionMachine:
    """State and motion of one controller. Times are seconds on the loop's clock."""

    def __init__(
        self, dialect: Dialect, settings: FirmwareSettings, planner_blocks: int,
        say: Callable[[Message], None], displaced: Callable[[Vector], None],
    ) -> None:
        self.hal = dialect is GRBLHAL
        self.settings = settings
        self.say = say
        self._displaced = displaced
        self.state = ControllerState.IDLE
        self.alarm = 0
        self.critical = False
        self.stopping: StopReason | None = None
        self.restore_s: float | None = None  # when motion resumes after the door was closed
        self.homed = False
        self.door_open = False
        self.estop_open = False
        self.overrides = (100, 100, 100)
        self.probed_mm = _ORIGIN
        self.input_result: int | None = None
        self.now_s = 0.0
        self.trace = MotionTrace(_ORIGIN)
        self.planner = LookAheadPlanner(planner_blocks, settings.kinematics())
        segments = _SEGMENTS[self.hal]
        self.stepper = Stepper(self.planner, self.trace, segments * _SEGMENT_S, segments)
        self.reporter = StatusReporter(dialect)
        self.accessories = Accessories(settings, self.stepper, self.reporter, self.hal)
        self._door_after_jog = False

    def advance_to(self, now_s: float) -> None:
        """Let time pass to now_s."""
        self.now_s = now_s
        stepper = self.stepper
        stepper.advance(now_s)
        if self.stopping is not None:
            if stepper.is_stopped(now_s):
                self._has_stopped()
        elif self.state in MOVING_STATES:
            if self.state is not ControllerState.HOME and stepper.is_stopped(now_s):
                stepper.running = False
                self.state = ControllerState.IDLE
        elif self.restore_s is not None and now_s >= self.restore_s:
            self._go_on()

    def start_planned_motion(self) -> None:
        """Execute the planned motion if the state allows it (the firmware's auto cycle start)."""
        if self.state is ControllerState.IDLE and self.planner.first is not None:
            self.state = ControllerState.RUN
            self.stepper.start(self.now_s)

    def is_at_rest(self) -> bool:
        """All motion has been executed."""
        return self.planner.first is None and self.stepper.is_stopped(self.now_s)

    def is_held(self) -> bool:
        """A hold or door stop is complete."""
        return self.state in (ControllerState.HOLD, ControllerState.DOOR) and self.stopping is None

    def next_event_s(self) -> float:
        """When planned motion next causes a change without further input."""
        return self.stepper.next_event_s()

    def position_mm(self) -> Vector:
        """Position of the axes, in whole steps."""
        x, y, z = self.stepper.position_mm(self.now_s)
        sx, sy, sz = self.planner.kinematics.steps_per_mm
        return (round(x * sx) / sx, round(y * sy) / sy, round(z * sz) / sz)

    # --- real-time commands

    def enter_hold(self) -> None:
        if self.state is ControllerState.JOG:
            self.cancel_jog()
        elif self.state in (ControllerState.RUN, ControllerState.IDLE):
            self._brake(StopReason.HOLD)
            self.state = ControllerState.HOLD
            self._stopped_at_once()

    def enter_door_stop(self) -> None:
        """Stop for the safety door: axes, then beam and coolant."""
        if self.state in (ControllerState.ALARM, ControllerState.CHECK, ControllerState.SLEEP,
                          ControllerState.HOME, ControllerState.TOOL):
            return
        if self.hal and self.state is ControllerState.DOOR:
            return
        self.say(FeedbackMessage("MSG", "Check Door"))
        self.restore_s = None
        if self.state is ControllerState.JOG:
            self.cancel_jog()
            self._door_after_jog = True
            return
        if self.stopping is None:
            self._brake(StopReason.DOOR)
        self.stopping = StopReason.DOOR
        self.state = ControllerState.DOOR
        self._stopped_at_once()

    def cancel_jog(self) -> None:
        if self.state is ControllerState.JOG and self.stopping is None:
            self._brake(StopReason.JOG_CANCEL)

    def stop_for_soft_limit(self) -> None:
        """A target is outside the travel: decelerate to rest, then enter Alarm."""
        if self.state is ControllerState.RUN:
            self.state = ControllerState.HOLD
        self._brake(StopReason.SOFT_LIMIT)
        self._stopped_at_once()

    def resume(self) -> None:
        if self.state is ControllerState.HOLD and self.stopping is None:
            if self.accessories.spindle_stopped:
                self.say(FeedbackMessage("MSG", "Restoring spindle"))
            if self.hal:
                self.say(FeedbackMessage("MSG", ""))
            self._go_on()
        elif self.state is ControllerState.DOOR and self.is_held() and not self.door_open:
            if self.restore_s is None:
                self.restore_s = self.now_s + self.accessories.restore_delay_s()
                self.advance_to(self.now_s)
        elif self.state is ControllerState.TOOL:
            self.state = ControllerState.IDLE
            self.start_planned_motion()

    def toggle_spindle_stop(self) -> None:
        if self.state is not ControllerState.HOLD or self.stopping is not None:
            return
        if self.accessories.spindle_stopped:
            self.say(FeedbackMessage("MSG", "Restoring spindle"))
            self.accessories.restore_spindle(self.now_s)
        else:
            self.accessories.stop_spindle()

    def toggle_coolant(self, mist: bool) -> None:
        if self.state in (ControllerState.IDLE, ControllerState.RUN, ControllerState.HOLD):
            on = self.accessories
            on.set_coolant(on.flood != (not mist), on.mist != mist)

    def set_overrides(self, feed: int, rapid: int, spindle: int) -> None:
        """Set the overrides [percent], clipped to the firmware's limits."""
        wanted = (min(200, max(10, feed)), rapid, min(200, max(10, spindle)))
        if wanted == self.overrides:
            return
        self.overrides = wanted
        self.stepper.set_overrides(
            wanted[0] / 100.0, wanted[1] / 100.0, wanted[2] / 100.0, self.now_s
        )
        self.reporter.on_overrides_changed()

    def reset(self) -> int:
        """Switch all off and drop the plan; keep the position. Returns the alarm to raise, or 0."""
        moving = self.state in MOVING_STATES or self.stopping is not None
        homing = self.state is ControllerState.HOME
        locked = self.state is ControllerState.ALARM or (self.state is ControllerState.SLEEP)
        self._stop_dead()
        self.critical = self.estop_open and self.hal
        self._door_after_jog = False
        self.accessories.switch_all_off(self.now_s)
        self.set_overrides(100, 100, 100)
        self.reporter.on_restart()
        alarm = 0
        if self.critical:
            alarm = ESTOP_ALARM
        elif homing:
            alarm = HOMING_ALARM
        elif moving and not self.hal:
            alarm = ABORTED_ALARM
        self.alarm = alarm or (self.alarm if locked else 0)
        self.state = ControllerState.ALARM if alarm or locked else ControllerState.IDLE
        if alarm:
            self.homed = False
        return alarm

    def stop_keeping_state(self) -> None:
        """grblHAL's 0x19: stop at once, drop the plan, keep position and offsets."""
        self._stop_dead()
        self.accessories.switch_all_off(self.now_s)
        if self.state is not ControllerState.ALARM:
            self.state = ControllerState.IDLE

    def stop_immediately(self, code: int) -> None:
        """A limit switch or the e-stop input: motion and beam end at once, wherever they are."""
        if code != ESTOP_ALARM or self.state in MOVING_STATES or self.stopping is not None:
            self.homed = False
        self._stop_dead()
        self._door_after_jog = False
        self.raise_alarm(code)

    def lose_power(self) -> None:
        """Lose all but the settings. The axes stay in place; that position becomes 0, 0, 0."""
        self._stop_dead()
        self.critical = self.homed = self._door_after_jog = False
        self.accessories.switch_all_off(self.now_s)
        self.set_overrides(100, 100, 100)
        self.reporter.on_restart()
        self.alarm = 0
        self.state = ControllerState.IDLE
        (x, y, z), (dx, dy, dz) = self.trace.position_at(self.now_s), self.trace.position_error_mm
        self.set_position(_ORIGIN, (x + dx, y + dy, z + dz))

    def set_position(self, believed_mm: Vector, shift_mm: Vector) -> None:
        """At standstill, set the controller's position. shift_mm : true less believed position"""
        self.trace.record_position_shift(self.now_s, believed_mm, shift_mm)
        self.planner.clear(believed_mm)
        self._displaced(believed_mm)

    def raise_alarm(self, code: int) -> None:
        """Enter Alarm. After a limit switch or e-stop only a reset unlocks."""
        self.alarm = code
        self.state = ControllerState.ALARM
        self.say(AlarmMessage(code))
        self.accessories.switch_all_off(self.now_s)
        if code in _CRITICAL:
            self.critical = True
            text = "Emergency stop - clear, then reset" if code == ESTOP_ALARM else "Reset"
            self.say(FeedbackMessage("MSG", f"{text} to continue"))

    def _stop_dead(self) -> None:
        self.stepper.stop_immediately(self.now_s)
        self.stopping = self.restore_s = None
        self._displaced(self.planner.position_mm)

    def _brake(self, why: StopReason) -> None:
        self.stopping = why
        self.stepper.brake(self.now_s)

    def _stopped_at_once(self) -> None:
        if self.stopping is not None and self.stepper.is_stopped(self.now_s):
            self._has_stopped()

    def _has_stopped(self) -> None:
        why, self.stopping = self.stopping, None
        if why is StopReason.HOLD:
            if self.settings.is_laser_mode and self.settings.is_laser_off_in_hold:
                self.accessories.stop_spindle()
        elif why is StopReason.DOOR:
            self.accessories.stop_for_door()
        else:
            self.stepper.discard_plan(self.now_s)
            self._displaced(self.planner.position_mm)
            if why is StopReason.SOFT_LIMIT:
                self.raise_alarm(SOFT_LIMIT_ALARM)
            elif self._door_after_jog:
                self._door_after_jog = False
                self.state = ControllerState.DOOR
            else:
                self.state = ControllerState.IDLE

    def _go_on(self) -> None:
        self.restore_s = None
        self.accessories.restore(self.now_s)
        self.state = ControllerState.IDLE
        if self.planner.first is not None:
            self.state = ControllerState.RUN
            self.stepper.start(self.now_s)
