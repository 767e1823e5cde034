"""Interlocks: conditions that must hold during a run, and the alarms raised otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.interlocks.alarms import EmergencyStopError as EmergencyStopError
    from lmctl.run.interlocks.alarms import InterlockError as InterlockError
    from lmctl.run.interlocks.alarms import RunAlarm as RunAlarm
    from lmctl.run.interlocks.alarms import RunAlarms as RunAlarms
    from lmctl.run.interlocks.alarms import RunTripError as RunTripError
    from lmctl.run.interlocks.alarms import alarm_name_of as alarm_name_of
    from lmctl.run.interlocks.inputs import FeederAnswerAge as FeederAnswerAge
    from lmctl.run.interlocks.inputs import FeederReading as FeederReading
    from lmctl.run.interlocks.inputs import InterlockInputs as InterlockInputs
    from lmctl.run.interlocks.inputs import ProgramDeviation as ProgramDeviation
    from lmctl.run.interlocks.inputs import UncommandedOutput as UncommandedOutput
    from lmctl.run.interlocks.inputs import feeder_reading as feeder_reading
    from lmctl.run.interlocks.rule import InterlockFinding as InterlockFinding
    from lmctl.run.interlocks.supervision import InterlockSupervision as InterlockSupervision
    from lmctl.run.interlocks.warnings import WarningDebounce as WarningDebounce

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "EmergencyStopError": "lmctl.run.interlocks.alarms",
    "FeederAnswerAge": "lmctl.run.interlocks.inputs",
    "FeederReading": "lmctl.run.interlocks.inputs",
    "InterlockError": "lmctl.run.interlocks.alarms",
    "InterlockFinding": "lmctl.run.interlocks.rule",
    "InterlockInputs": "lmctl.run.interlocks.inputs",
    "InterlockSupervision": "lmctl.run.interlocks.supervision",
    "ProgramDeviation": "lmctl.run.interlocks.inputs",
    "RunAlarm": "lmctl.run.interlocks.alarms",
    "RunAlarms": "lmctl.run.interlocks.alarms",
    "RunTripError": "lmctl.run.interlocks.alarms",
    "UncommandedOutput": "lmctl.run.interlocks.inputs",
    "WarningDebounce": "lmctl.run.interlocks.warnings",
    "alarm_name_of": "lmctl.run.interlocks.alarms",
    "feeder_reading": "lmctl.run.interlocks.inputs",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
