"""Inputs of the interlocks: the last report of every device, each with its age."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from firmware_protocol.pmx_alarms import CLIPPED
from firmware_protocol.status import StatusReport
from lmctl.config.machine import HopperSettings, SafetySettings
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.safety.status import SafetyStatus

#: Reports missing before a device counts as silent (docs/explanation/safety-and-sequences.md, Host
#: duties).
STALE_PERIODS = 3

#: Queries that the motion controller must have left unanswered by then. A host that was suspended
#: has sent none; but by the end of the send horizon motion has run dry, queried or not.
STALE_QUESTIONS = 3


class FeederReading(NamedTuple):
    """What matters of a feeder's last good answer. name : of the feeder

    hoppers : those in use, once powder runs and has settled, with what was read of each
    clipped : it feeds, and has clipped a set-point; the names of the hoppers, as far as known
    mixer_mbar, mixer_max_mbar : pressure reported and limit in the profile; None: not known
    """

    name: str
    hoppers: Sequence[tuple[HopperSettings, HopperReading]] = ()
    clipped: Sequence[str] | None = None
    mixer_mbar: float | None = None
    mixer_max_mbar: float | None = None


class FeederAnswerAge(NamedTuple):
    """How old a feeder's last good answer is. wire_symptoms : what came instead, in words"""

    name: str
    age_s: float
    period_s: float
    wire_symptoms: str = ""


class UncommandedOutput(NamedTuple):
    """What a controller reports although its program does not command it.

    speed_mm_s, power_W : as reported
    max_speed_mm_s : the highest speed of the lines that may be running
    commanded_powers_W : the powers they command at the speed reported, rising; none where none of
        them moves
    """

    speed_mm_s: float
    max_speed_mm_s: float
    power_W: float
    commanded_powers_W: tuple[float, ...]


class ProgramDeviation(NamedTuple):
    """How the machine differs from its program, by the last report.

    path_error_mm : how far the nozzle is from the lines that may be running
    ahead_of_program_s : by how much it was there sooner than programmed
    uncommanded_output : feed or power that none of those lines commands
    """

    path_error_mm: float = 0.0
    ahead_of_program_s: float = 0.0
    uncommanded_output: UncommandedOutput | None = None


class InterlockInputs(NamedTuple):
    """All a rule may look at.

    standstill_s : for how long the controller has reported Run without moving, the program's own
        waits left out
    deviation : none where no program runs
    feeder_readings : the same object until a feeder answers again
    safety, limits : None where the cell has no safety-input device
    motion_age_s : since the last plausible report of the motion controller
    motion_unreadable : answers since then that were unreadable or implausible
    motion_unanswered : it has been queried several times since then, or has run dry
    """

    motion: StatusReport | None
    standstill_s: float
    deviation: ProgramDeviation
    motion_age_s: float
    motion_period_s: float
    feeders: Sequence[FeederAnswerAge]
    feeder_readings: Sequence[FeederReading]
    safety: SafetyStatus | None
    safety_age_s: float
    limits: SafetySettings | None
    motion_unreadable: int = 0
    motion_unanswered: bool = True


def feeder_reading(
    feeder: str, status: FeederStatus | None, hoppers: Iterable[HopperSettings],
    mixer_max_mbar: float | None,
) -> FeederReading:
    """What interlocks look at of a feeder's answer. mixer_max_mbar : of the profile"""
    if status is None:
        return FeederReading(feeder)
    readings = status.hoppers
    clipped = None
    if status.clipped and status.feeding:
        clipped = [w.hopper for w in status.warnings if w.number == CLIPPED]
    settled = hoppers if status.feeding and status.stable else ()
    return FeederReading(
        feeder, tuple((h, readings[h.name]) for h in settled if h.name in readings), clipped,
        status.mixer_pressure_mbar, mixer_max_mbar,
    )
