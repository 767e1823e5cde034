"""Keeps the position of a homed machine between commands, where its controller does not report it.

Grbl does not report that it has homed: Idle with homing enabled ($22) may mean homed, or only
unlocked. So a command that leaves such a machine journals its position (machine coordinates)
and whether that position was trusted. The next command trusts it if nothing else was begun since
and the machine is still there to the micrometre the controller reports. A power cycle sets the
position to zero, a move from elsewhere changes it, a killed host leaves no such record: after each
of these the machine must be homed. grblHAL reports homed axes itself (`H:1`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_protocol.dialect import GRBL
from firmware_protocol.status import StatusReport
from lmctl.machine.manual.inspect_motion import MotionReading
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import ControllerIdentity, is_homing_enabled
from lmctl.run.journal.manual_journal import MachineJournal

_SAME_MM = 0.0015  # reports have three decimals


class LastKnownPosition:
    """One session with one machine, from before anything is done to it.

    runs_dir : where the machine's journal is; name : the profile's
    left : where the machine was last seen in this session, or left by the one before; as fields
        of the record that ends an act
    """

    def __init__(self, runs_dir: Path, name: str) -> None:
        self.journal = MachineJournal(runs_dir, name)
        last = self.journal.last_record() or {}
        ended = last.get("kind") == "ended"
        self.left: dict[str, Any] = {
            "machine_mm": last.get("machine_mm") if ended else None,
            "trusted": ended and last.get("trusted") is True,
        }
        self._run = ""

    def trust_if_unmoved(self, motion: MotionDriver) -> None:
        """Trust the position, where the machine is as the last session left it."""
        if _silent(motion.identity, motion.settings) and self._unmoved(
            motion.status, motion.offset_mm
        ):
            motion.trust_position()

    def would_trust_position(self, reading: MotionReading) -> bool:
        """Whether `trust_if_unmoved` would trust the position that an inspection has read."""
        identity = reading.identity
        return (identity is not None and _silent(identity, reading.settings)
                and self._unmoved(reading.report, reading.offset_mm))

    def _unmoved(self, report: StatusReport | None, offset_mm: tuple[float, ...] | None) -> bool:
        """Whether the machine is where the last session left it, and that was to be trusted."""
        if report is None or report.state != "Idle" or not self.left["trusted"]:
            return False
        at, left = _machine_mm(report, offset_mm), self.left["machine_mm"]
        return (
            at is not None and isinstance(left, list) and len(left) == len(at) and any(left)
            and all(abs(a - b) < _SAME_MM for a, b in zip(left, at, strict=True))
        )

    def record_position(self, motion: MotionDriver) -> None:
        """Note where the machine is, and whether that is to be trusted."""
        at = _machine_mm(motion.status, motion.offset_mm)
        self.left = {"machine_mm": None if at is None else [round(axis, 3) for axis in at],
                     "trusted": motion.position_trusted}

    def record_run_start(self, motion: MotionDriver, run: str) -> None:
        """A run is about to move the machine; durable, so that a killed one is seen."""
        if _silent(motion.identity, motion.settings):
            self.journal.append("act", do="run", run=run)
            self._run = run

    def record_run_end(self, motion: MotionDriver) -> None:
        """The run that began lets go of the machine."""
        if self._run:
            self.record_position(motion)
            self.journal.append("ended", do="run", run=self._run, **self.left)
            self._run = ""


def _silent(identity: ControllerIdentity, settings: Mapping[int, str]) -> bool:
    """Whether the controller homes, but does not report afterwards that it has."""
    return identity.dialect is GRBL and is_homing_enabled(settings)


def _machine_mm(
    report: StatusReport | None, offset_mm: tuple[float, ...] | None
) -> tuple[float, ...] | None:
    if report is None or report.machine_mm is not None:
        return None if report is None else report.machine_mm
    if report.work_mm is None or offset_mm is None:
        return None
    return tuple(w + o for w, o in zip(report.work_mm, offset_mm, strict=False))
