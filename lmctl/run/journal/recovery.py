"""Finds where a job resumes, from its journal and the machine position."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from firmware_protocol.dialect import Dialect
from lmctl.config.machine import MachineProfile, MotionSettings
from lmctl.errors import JournalError
from lmctl.job.reader import JobReader
from lmctl.machine.safety.laser_enable import LASER_OFF_DELAY_S
from lmctl.run.journal.position_proof import ON_LINE_MM, PositionProof, position_proof
from lmctl.run.journal.replay import RunReplay
from lmctl.run.program.approach import axis_limit_along
from lmctl.run.program.job_lines import (
    after_bead_mm,
    bead_between_mm,
    before_motion_mm,
    rows_between,
)
from lmctl.run.program.place import (
    JOB_START,
    NOTHING_REACHED,
    Known,
    PlaceReached,
    ProgramPlace,
    known_place,
    unknown_place,
)
from lmctl.run.program.reentry import plan_reentry

#: Less bead than this in doubt is no question for an operator [mm].
_NO_DOUBT_MM = 0.1

#: A device that runs for so much less than the time since a run has been switched off since [s].
_UPTIME_SLACK_S = 5.0


@dataclass(frozen=True)
class MachineSeen:
    """What a controller reported before anything was sent to it.

    position_mm : program coordinates, or None
    at_zero : whether its machine coordinates are 0, 0, 0
    restarted : whether it has sent its welcome message unasked
    homed : whether its homing, or the record of it, proves its position
    doubt : why its position is not to be believed, by homing and by where the last command left
        it, in words; "" where nothing speaks against it
    recorded_loss : the same, only where a command has seen the position get lost
    uptimes_s : for how long the other devices of the cell have run, by name
    """

    position_mm: tuple[float, ...] | None
    at_zero: bool
    restarted: bool
    homed: bool
    doubt: str
    recorded_loss: str
    dialect: Dialect
    uptimes_s: dict[str, float]


@dataclass(frozen=True)
class RecoveryPlace:
    """Where to resume, and how that is known.

    reached : where deposition ended; the operator must state it where that is doubtful
    reason : how it is known, in words
    lost : why the machine's position is not proven, in words; "" where it is
    """

    reached: PlaceReached
    reason: str
    lost: str


def find_recovery_place(
    job: JobReader, after: RunReplay, seen: MachineSeen, profile: MachineProfile
) -> RecoveryPlace:
    """The place up to which a run was executed, and whether the machine's position is proven.

    The reported position counts where it lies on a line that was sent and nothing shows that the
    controller has restarted. Else all lines sent may have been executed, and the operator is asked.
    """
    if not after.has_begun:
        return RecoveryPlace(NOTHING_REACHED, "nothing of the part had been begun", seen.doubt)
    proof = PositionProof(False, ())
    if seen.position_mm is not None:
        proof = position_proof(job, after, profile.motion, seen.position_mm)
    lost = _why_lost(after, seen, proof)
    if lost:
        reached, why = _unconfirmed(after.reached), _journal_says(after)
    else:
        reached, why = _by_machine(job, after, seen, proof, profile)
    doubt_mm = bead_between_mm(job, reached.place, reached.until)
    if reached.known is Known.UNKNOWN and doubt_mm <= _NO_DOUBT_MM:
        reached = replace(reached, known=Known.INFERRED, until=reached.place)
    return RecoveryPlace(reached, why, lost)


def stated_by_operator(job: JobReader, reached: PlaceReached, deposited_mm: float) -> PlaceReached:
    """The place, of a doubtful stretch, up to which the operator has found so much bead."""
    place = after_bead_mm(job, reached.place, reached.until, deposited_mm)
    return known_place(place, Known.STATED)


def refuse_finished(job: JobReader, after: RunReplay, place: ProgramPlace,
                    motion: MotionSettings) -> None:
    """Raise JournalError where no bead is left to deposit from a place on."""
    if place != JOB_START and plan_reentry(job.manifest, job.read_layer, place, motion) is None:
        raise JournalError(f"{after.run.run} has deposited every bead of its job: nothing is left",
                           hint=f"`{after.run.command('log')}` prints its log")


def doubt_in_words(job: JobReader, reached: PlaceReached) -> list[str]:
    """Which bead is in doubt, and from where to where."""
    words = []
    for rows in rows_between(job, reached.place.line, reached.until.line):
        for path in dict.fromkeys(rows.path[rows.is_bead].tolist()):
            path_rows = np.flatnonzero(rows.is_bead & (rows.path == path))
            first, last = int(path_rows[0]), int(path_rows[-1])
            line = int(rows.line[first]), int(rows.line[last])
            start = reached.place.line_fraction if line[0] == reached.place.line else 0.0
            end = reached.until.line_fraction if line[1] == reached.until.line else 1.0
            length_mm = bead_between_mm(job, ProgramPlace(line[0], start),
                                        ProgramPlace(line[1], end))
            if length_mm > 0.0:
                words.append(
                    f"path {path + 1} of layer {rows.layer + 1}: {length_mm:.1f} mm, from "
                    f"{_point(rows.at_mm(first, start))} (line {line[0]}) to "
                    f"{_point(rows.at_mm(last, end))} (line {line[1]})"
                )
    return words


def _why_lost(after: RunReplay, seen: MachineSeen, proof: PositionProof) -> str:
    """Why the position the controller reports is not proven; "" where it is."""
    if seen.position_mm is None:
        return "the controller does not say where it is"
    if seen.restarted:
        return "its controller has restarted: it sent its welcome message when the port was opened"
    restarted = _restarted_devices(after, seen)
    if seen.at_zero and not seen.homed and (restarted or not proof.is_unmoved):
        return "it says 0, 0, 0, as every controller does that was switched off and on"
    if not after.is_position_kept:
        return f"{after.run.run} ended with its position lost"
    if seen.recorded_loss:
        return seen.recorded_loss
    if not proof.is_explained:
        return (f"it says {_point(seen.position_mm)}, where nothing that {after.run.run} sent has "
                "brought it")
    if restarted and not proof.is_unmoved:
        return (f"{', '.join(restarted)} of its cell restarted since {after.run.run} ended, so the "
                "controller may have been switched off too")
    return ""


def _restarted_devices(after: RunReplay, seen: MachineSeen) -> list[str]:
    if after.ended_wall is None:
        return []
    since_s = (datetime.now(UTC) - after.ended_wall).total_seconds()
    return [name for name, up_s in seen.uptimes_s.items() if up_s < since_s - _UPTIME_SLACK_S]


def _by_machine(
    job: JobReader, after: RunReplay, seen: MachineSeen, proof: PositionProof,
    profile: MachineProfile,
) -> tuple[PlaceReached, str]:
    """Where deposition ended, by a machine whose position is proven."""
    reached, first, last = after.reached, proof.places[0], proof.places[-1]
    if reached.is_assumed and not after.moving:
        return _unconfirmed(reached), _journal_says(after)
    if reached.is_assumed and last < reached.place:
        return known_place(last, Known.REPORTED), "reported: the machine is there"
    if reached.known is not Known.UNKNOWN:
        return reached, _journal_says(after)
    if bead_between_mm(job, first, last) > _NO_DOUBT_MM:
        return (unknown_place(first, last, reached.reported_s),
                "unknown: the path passes the machine position more than once")
    beam_off_first = profile.safety is not None and profile.safety.laser_enable
    if not beam_off_first or first <= reached.place or _ran_dry(job, after, seen):
        return known_place(first, Known.REPORTED), "reported: the machine is there"
    tail_mm, tail_s = _beam_off_tail(job, first, seen.dialect, profile.motion)
    ended = max(reached.place, before_motion_mm(job, first, tail_mm))
    return PlaceReached(
        ended, Known.INFERRED, ended, ended, beam_off_motion_s=tail_s,
    ), "inferred: the machine is a little farther on, its laser-enable output dropped first"


def _unconfirmed(reached: PlaceReached) -> PlaceReached:
    """A place that was inferred from motion going on, where the machine no longer shows that."""
    if not reached.is_assumed:
        return reached
    return unknown_place(reached.at_least, reached.place, reached.reported_s)


def _ran_dry(job: JobReader, after: RunReplay, seen: MachineSeen) -> bool:
    """Whether the machine is at the end of what it was sent: nothing stopped it before."""
    if after.sent_line < 0 or seen.position_mm is None:
        return False
    rows = next(rows_between(job, after.sent_line, after.sent_line))
    off_mm = rows.end_mm[0] - np.asarray(seen.position_mm[:3])
    return bool(np.linalg.norm(off_mm) <= ON_LINE_MM)


def _beam_off_tail(
    job: JobReader, place: ProgramPlace, dialect: Dialect, motion: MotionSettings
) -> tuple[float, float]:
    """How far [mm], and how long [s], a nozzle moves on after its beam went off, where both are
    stopped at once: the controller first executes the motion it has prepared, then brakes."""
    rows = next(rows_between(job, place.line, place.line))
    away_mm, speed_mm_s = rows.end_mm[0] - rows.start_mm[0], float(rows.speed_mm_s[0])
    if not away_mm.any():
        return 0.0, 0.0
    prepared_s = max(0.0, dialect.segment_buffer_s - LASER_OFF_DELAY_S)
    braking_s = speed_mm_s / axis_limit_along(motion.acceleration_mm_s2, away_mm)
    return speed_mm_s * (prepared_s + braking_s / 2.0), prepared_s + braking_s


def _journal_says(after: RunReplay) -> str:
    reached = after.reached
    at = "" if reached.reported_s is None else f" at {reached.reported_s:.1f} s of that run"
    return {
        Known.REPORTED: f"reported at standstill{at}",
        Known.INFERRED: "inferred from what was sent and the clock, and from the last report on "
                        f"the path{at}",
        Known.STATED: "stated by the operator who recovered before",
        Known.UNKNOWN: f"unknown: it was reported there{at}, and what was sent after that may "
                       "have been executed",
    }[reached.known]


def _point(at_mm: Iterable[float]) -> str:
    return " ".join(f"{axis}{value:.1f}" for axis, value in zip("XYZ", at_mm, strict=False))
