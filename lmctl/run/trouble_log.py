"""Records the faults of a run in the list of alarms and in the journal, cause first."""

from __future__ import annotations

from lmctl.errors import LmctlError
from lmctl.run.interlocks.alarms import RunAlarms, alarm_name_of
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.state.transitions import RunEvent, RunState


class TroubleLog:
    """The logbook of a run's state machine.

    alarms : receives every fault, also those that no interlock has found
    """

    def __init__(self, alarms: RunAlarms, recorder: RunRecorder) -> None:
        self._alarms = alarms
        self._recorder = recorder

    def record_state(self, event: RunEvent, before: RunState, after: RunState) -> None:
        """A transition."""
        self._recorder.record_state(event, before, after)

    def record_fault(self, error: Exception) -> None:
        """A reason to hold or to end the run, or what follows from one."""
        follows = ""
        if isinstance(error, LmctlError):
            self._alarms.add(error, self._recorder.now_s())
            cause = self._alarms.cause
            if cause is not None and alarm_name_of(
                error) != cause.name and error.what != cause.what:
                follows = cause.what
        self._recorder.record_fault(error, follows)
