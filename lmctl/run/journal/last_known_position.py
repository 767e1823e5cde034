"""Keeps the position of a machine between commands, where its controller cannot prove it.

Grbl does not report that it has homed: Idle with homing enabled ($22) may mean homed, or only
unlocked. So a command that leaves such a machine journals its position (machine coordinates)
and whether that position was trusted. The next command trusts it if nothing else was begun since
and the machine is still there to the micrometre the controller reports. A power cycle sets the
position to zero, a move from elsewhere changes it, a killed host leaves no such record: after each
of these the machine must be homed. grblHAL reports homed axes itself (`H:1`).

A controller without homing ($22=0) is believed the first time. From then on its position must be
the one it was left at; `position_history` has the rules, and how a lost position is restored.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_protocol.dialect import GRBL
from firmware_protocol.status import StatusReport
from lmctl.config.machine import MachineProfile, MotionSettings
from lmctl.machine.manual.inspect_motion import MotionReading
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import ControllerIdentity, is_homing_enabled
from lmctl.run.journal.manual_journal import MachineJournal
from lmctl.run.journal.position_history import (
    SAME_MM,
    PositionHistory,
    read_position_history,
    way_to_purge_mm,
)


class LastKnownPosition:
    """One session with one machine, from before anything is done to it.

    runs_dir : where the machine's journal is
    left : where the machine was last seen in this session, or left by the one before; as fields
        of the record that ends an act
    history : of its positions, as the sessions before have left it
    """

    def __init__(self, runs_dir: Path, profile: MachineProfile) -> None:
        self.journal = MachineJournal(runs_dir, profile)
        records = self.journal.records_of_this_machine()
        last = records[-1] if records else {}
        ended = last.get("kind") == "ended"
        self.left: dict[str, Any] = {
            "machine_mm": last.get("machine_mm") if ended else None,
            "trusted": ended and last.get("trusted") is True,
        }
        self.history: PositionHistory = read_position_history(records)
        self._run = ""
        self._doubt = ""

    def judge_position(self, motion: MotionDriver) -> None:
        """Trust the controller's position where the last session explains it, else do not.

        A position that the controller itself proves is left as it is.
        """
        if _homes_silently(motion.identity, motion.settings):
            if self._unmoved(motion.status, motion.offset_mm):
                motion.trust_position()
        elif not is_homing_enabled(motion.settings):
            self._doubt = self._why_lost(motion.status, motion.offset_mm)
            if self._doubt:
                motion.distrust_position(self._doubt)

    def judged(self, reading: MotionReading) -> tuple[bool, str]:
        """Whether the position that an inspection has read is trusted, and why it is lost."""
        identity = reading.identity
        if identity is None or not reading.settings:
            return reading.is_position_trusted, ""
        if _homes_silently(identity, reading.settings):
            unmoved = self._unmoved(reading.report, reading.offset_mm)
            return reading.is_position_trusted or unmoved, ""
        if is_homing_enabled(reading.settings):
            return reading.is_position_trusted, ""
        doubt = self._why_lost(reading.report, reading.offset_mm)
        return reading.is_position_trusted and not doubt, doubt

    def _why_lost(self, report: StatusReport | None, offset_mm: tuple[float, ...] | None) -> str:
        at_mm = _machine_mm(report, offset_mm)
        return "" if at_mm is None else self.history.why_lost(at_mm)

    def _unmoved(self, report: StatusReport | None, offset_mm: tuple[float, ...] | None) -> bool:
        """Whether the machine is where the last session left it, and that was to be trusted."""
        if report is None or report.state != "Idle" or not self.left["trusted"]:
            return False
        at, left = _machine_mm(report, offset_mm), self.left["machine_mm"]
        return (
            at is not None and isinstance(left, list) and len(left) == len(at) and any(left)
            and all(abs(a - b) < SAME_MM for a, b in zip(left, at, strict=True))
        )

    def record_position(self, motion: MotionDriver) -> None:
        """Note where the machine is, and whether that is to be trusted."""
        at = _machine_mm(motion.status, motion.offset_mm)
        self.left = {"machine_mm": None if at is None else [round(axis, 3) for axis in at],
                     "trusted": motion.position_trusted, "seen": True}
        if not motion.position_trusted and not is_homing_enabled(motion.settings):
            self.left["lost"] = self._doubt or (
                "its controller restarted" if motion.restarted
                else "it was stopped in motion, by an alarm or a reset")

    def record_run_start(
        self, motion: MotionDriver, run: str, settings: MotionSettings
    ) -> None:
        """A run is about to move the machine; durable, so that a killed one is seen."""
        if not (_homes_silently(motion.identity, motion.settings)
                or not is_homing_enabled(motion.settings)):
            return
        from_mm, way_mm = _machine_mm(motion.status, motion.offset_mm), []
        if motion.position_mm is not None and motion.offset_mm is not None:
            way_mm = (way_to_purge_mm(motion.position_mm, settings)
                      + motion.offset_mm[:3]).round(3).tolist()
        self.journal.append("act", do="run", run=run, from_mm=from_mm, way_mm=way_mm)
        self._run, self._doubt = run, ""

    def record_run_end(self, motion: MotionDriver) -> None:
        """The run that began lets go of the machine."""
        if self._run:
            self.record_position(motion)
            if "lost" in self.left:
                self.left["lost"] = f"{self._run} ended with it lost: {self.left['lost']}"
            self.journal.append("ended", do="run", run=self._run, **self.left)
            self._run = ""


def _homes_silently(identity: ControllerIdentity, settings: Mapping[int, str]) -> bool:
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
