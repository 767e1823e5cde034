"""Forwards device reports: progress to the deposition, errors in words to the run."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.codes import alarm_meaning, error_meaning
from firmware_protocol.status import StatusReport
from lmctl.config.machine import MachineProfile
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.feeder.status import FeederCallbacks, FeederStatus
from lmctl.machine.feeder.warnings import FeederWarning
from lmctl.machine.motion.driver import MotionCallbacks
from lmctl.machine.safety.status import SafetyCallbacks, SafetyStatus
from lmctl.run.cell.devices import Cell
from lmctl.run.execution.deposition import Deposition
from lmctl.run.interlocks.alarms import InterlockError, RunAlarms, RunTripError
from lmctl.run.interlocks.board import InterlockRow
from lmctl.run.interlocks.inputs import (
    STALE_PERIODS,
    STALE_QUESTIONS,
    FeederAnswerAge,
    FeederReading,
    InterlockInputs,
    feeder_reading,
)
from lmctl.run.interlocks.rules import INTERLOCK_RULES, INTERLOCK_RULES_WITHOUT_SAFETY
from lmctl.run.interlocks.supervision import InterlockSupervision
from lmctl.run.interlocks.warnings import WarningDebounce
from lmctl.run.journal.recorder import RunRecorder

#: Alarms that a restarting or lost controller causes before that is known.
_SYMPTOMS = ("motion silent", "position", "path", "wait", "feed and power")

#: Alarms that a restarting or silent safety device causes before that is known.
_SYMPTOMS_OF_SAFETY = ("safety inputs silent", "watchdog relay", "controller's door")

#: Check period while a device stays silent [s].
_STALE_LOOKS_S = 0.02

#: Timers may come early by the resolution of the clock [s].
_MIN_WAIT_S = 1e-3


class DeviceMonitor:
    """Monitors every device of a cell from now on, and checks the interlocks with each report.

    deposition : the one under way
    tripped : called with each reason to hold (Interlock) or to end the run
    held : whether a hold that the machine reports is this run's own
    """

    def __init__(
        self, cell: Cell, profile: MachineProfile, deposition: Callable[[], Deposition],
        alarms: RunAlarms, recorder: RunRecorder, tripped: Callable[[Exception], None],
        held: Callable[[], bool],
    ) -> None:
        self._cell = cell
        self._profile = profile
        self._deposition = deposition
        self._alarms = alarms
        self._recorder = recorder
        self._tripped = tripped
        self._held = held
        self._loop = asyncio.get_running_loop()
        rules = INTERLOCK_RULES if cell.safety is not None else INTERLOCK_RULES_WITHOUT_SAFETY
        self._supervision = InterlockSupervision(self._raise, rules, self._cleared)
        # When the reported place last changed or did not have to, and when it was last reported:
        # while the host sleeps, it is unknown whether it changes.
        self._moved_t = self._reported_t = self._loop.time()
        self._last_mm: tuple[float, ...] | None = None
        cell.motion.listener = MotionCallbacks(
            on_query=lambda: deposition().on_query(),
            on_progress=lambda: deposition().on_progress(), on_status=self._motion_status,
            on_error=self._line_rejected, on_alarm=self._motion_alarm,
            on_restart=self._motion_restarted, on_lost=self._motion_lost,
        )
        self._mixer_max_mbar = {one.name: one.mixer_pressure_max_mbar for one in profile.feeder}
        self._answers = tuple(self._said(feeder, feeder.status) for feeder in cell.feeders)
        self._warnings = [WarningDebounce(self._warn) for _ in cell.feeders]
        for at, feeder in enumerate(cell.feeders):
            feeder.callbacks = self._feeder_listener(at, feeder)
            if feeder.status is not None:
                self._warnings[at].update(feeder.status.warnings)
        if cell.safety is not None:
            cell.safety.callbacks = SafetyCallbacks(
                on_status=self._safety_status, on_fault=self._safety_fault
            )
        # Reports drive everything else; this one notices that they have stopped, when they have.
        self._stale_s = STALE_PERIODS * profile.motion.status_period_s
        self._timer = self._loop.call_later(0.0, self._look_where_stale)

    def stop(self) -> None:
        """Stop monitoring."""
        self._timer.cancel()
        self._cell.motion.listener = MotionCallbacks()
        for feeder, warnings in zip(self._cell.feeders, self._warnings, strict=True):
            feeder.callbacks = FeederCallbacks()
            warnings.stop()
        if self._cell.safety is not None:
            self._cell.safety.callbacks = SafetyCallbacks()

    def active_alarms(self) -> list[MachineError]:
        """Which interlocks hold at this moment."""
        return self._supervision.active_alarms(self._facts())

    def interlock_board(self) -> list[InterlockRow]:
        """Every interlock as it is at this moment."""
        return self._supervision.board(self._facts())

    def acknowledge(self) -> None:
        """The operator has acknowledged the alarms: report again what still holds."""
        for alarm in self._alarms:
            self._clear(alarm.name, "acknowledged")
        self._alarms.acknowledge()
        self._supervision.acknowledge()

    # --- devices ------------------------------------------------------------------------------

    def _motion_status(self, report: StatusReport) -> None:
        self._deposition().on_status(report)
        at_mm, self._reported_t = self._cell.motion.position_mm, self._loop.time()
        if at_mm != self._last_mm or report.state != "Run" or not self._deposition(
            ).is_motion_expected:
            self._last_mm, self._moved_t = at_mm, self._reported_t
        self._look()
        if not self._held():
            self._check_hold(report)
        self._cell.notify_report()

    def _check_hold(self, report: StatusReport) -> None:
        """A feed hold was pressed at the machine, however briefly: it would wait for ever.

        Raised only at rest: a controller that runs into a limit slows down first, too.
        """
        if report.state == "Hold" and report.is_held:
            self._raise(InterlockError("panel hold", "feed hold was pressed at the machine",
                                       hint="resume when it may go on"))
        elif report.state == "Door" and report.substate == 0:
            self._raise(InterlockError("door", "the safety door was opened, and is closed again",
                                       hint="look at the part, then resume"))

    def _line_rejected(self, tag: int, code: int) -> None:
        """The text was checked before the run: the controller received something else."""
        meaning = error_meaning(code, self._cell.motion.identity.dialect)
        line = self._deposition().job_line(tag)
        self._raise(RunTripError(
            "program line rejected",
            f"program line {line} was damaged on its way or is wrong: {meaning.description}",
            where=f"error {code} of the motion controller",
            hint="it had been checked before, so look at cable and earthing of the controller; "
            f"else {meaning.remedy}",
        ))

    def _motion_alarm(self, code: int) -> None:
        meaning = alarm_meaning(code, self._cell.motion.identity.dialect)
        self._raise(RunTripError(f"motion alarm {code}",
                                 f"the motion controller is in alarm: {meaning.description}",
                                 where=f"alarm {code}", hint=meaning.remedy))

    def _motion_restarted(self) -> None:
        self._raise(RunTripError(
            "motion restarted", "the motion controller restarted in the middle of the run",
            where="its position is lost",
            hint="look for a loose power or reset line, then home the machine",
            explains=_SYMPTOMS,  # while it boots it reports nothing
        ))

    def _motion_lost(self, reason: str) -> None:
        self._raise(RunTripError(
            "motion lost", f"the motion controller is lost: {reason}",
            where="it runs dry and the beam goes out within the send horizon",
            hint="check cable and power of the controller",
            explains=() if self._cell.motion.is_silent else _SYMPTOMS,
        ))

    def _feeder_listener(self, at: int, feeder: FeederDriver) -> FeederCallbacks:
        warnings = self._warnings[at]

        def status(answer: FeederStatus) -> None:
            answers = self._answers
            self._answers = (*answers[:at], self._said(feeder, answer), *answers[at + 1:])
            warnings.update(answer.warnings)
            self._cell.notify_report()

        def fault(reason: str) -> None:
            error = feeder.fault
            assert error is not None, f"it has just been told: {reason}"
            self._raise(InterlockError(
                f"feeder {feeder.name}", error.what, where=error.where, hint=error.hint,
                explains=[f"feeder silent {feeder.name}"]))

        return FeederCallbacks(on_status=status, on_fault=fault)

    def _said(self, feeder: FeederDriver, answer: FeederStatus | None) -> FeederReading:
        return feeder_reading(feeder.name, answer, feeder.hoppers,
                              self._mixer_max_mbar[feeder.name])

    def _warn(self, warning: FeederWarning, is_active: bool) -> None:
        self._recorder.record_warning(warning, is_active=is_active)
        self._alarms.set_warning(warning, is_active=is_active)

    def _safety_status(self, _: SafetyStatus) -> None:
        self._look()
        self._cell.notify_report()

    def _safety_fault(self, reason: str, hint: str) -> None:
        self._raise(InterlockError("safety device", f"safety device: {reason}", hint=hint,
                                   explains=_SYMPTOMS_OF_SAFETY))

    # --- interlocks ---------------------------------------------------------------------------

    def _look(self) -> None:
        t = self._loop.time()
        facts = self._facts()
        beam_off = facts.motion is not None and not facts.motion.spindle_speed
        self._supervision.evaluate(facts, t, beam_off=beam_off)
        if self._supervision.has_unconfirmed_findings:
            for feeder in self._cell.feeders:
                feeder.request_hopper_readings()

    def _look_where_stale(self) -> None:
        """Check when the last report of motion controller or safety device becomes stale."""
        left_s = self._stale_s - self._cell.motion.status_age_s
        if self._cell.safety is not None and self._profile.safety is not None:
            safety_stale_s = STALE_PERIODS * self._profile.safety.period_s
            left_s = min(left_s, safety_stale_s - self._cell.safety.status_age_s)
        if left_s <= 0.0:
            self._look()
            left_s = _STALE_LOOKS_S
        self._timer = self._loop.call_later(max(left_s, _MIN_WAIT_S), self._look_where_stale)

    def _cleared(self, name: str) -> None:
        """The cause of an alarm is no longer found."""
        self._clear(name, "its cause is gone")

    def _clear(self, name: str, how: str) -> None:
        alarm = self._alarms.clear(name, self._recorder.now_s())
        if alarm is not None:
            self._recorder.record_alarm_cleared(alarm, how)

    def _raise(self, error: MachineError) -> None:
        alarm = self._alarms.add(error, self._recorder.now_s())
        if alarm is not None:
            self._recorder.record_alarm(alarm)
            self._tripped(error)

    def _facts(self) -> InterlockInputs:
        cell, safety = self._cell, self._cell.safety
        return InterlockInputs(
            motion=cell.motion.status,
            standstill_s=self._reported_t - self._moved_t,
            deviation=self._deposition().program_deviation,
            motion_age_s=cell.motion.status_age_s,
            motion_period_s=self._profile.motion.status_period_s,
            feeders=[
                FeederAnswerAge(feeder.name, feeder.status_age_s, feeder.period_s,
                                feeder.wire_symptoms)
                for feeder in cell.feeders
            ],
            feeder_readings=self._answers,
            safety=None if safety is None else safety.status,
            safety_age_s=0.0 if safety is None else safety.status_age_s,
            limits=self._profile.safety if safety is not None else None,
            motion_unreadable=cell.motion.unreadable_answer_count,
            motion_unanswered=(
                cell.motion.unanswered_query_count >= STALE_QUESTIONS
                or cell.motion.status_age_s >= self._profile.motion.send_horizon_s
            ),
        )
