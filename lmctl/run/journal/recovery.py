"""From what a journal proves and where the machine stands to the place where a job goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.config.machine import MotionSettings
from lmctl.errors import JournalError
from lmctl.job.reader import JobReader
from lmctl.run.journal.replay import RunReplay
from lmctl.run.program.reentry import JOB_START, ProgramPlace, layer_of, plan_reentry

FloatArray = NDArray[np.float64]

#: A machine this near to a line of the program stands on it [mm]: steps and rounding are finer.
ON_LINE_MM = 0.05


@dataclass(frozen=True)
class RecoveryPlace:
    """Where to go on, and how that is known.

    matched : the machine stands where the job says, and nothing has made it lose its position
    """

    place: ProgramPlace
    matched: bool
    reason: str


def find_place(
    job: JobReader, after: RunReplay, position_mm: Sequence[float] | None
) -> RecoveryPlace:
    """The place up to which a run was executed.

    position_mm : where the machine stands in program coordinates, as it said before anything was
        sent to it; None where that is not known
    A machine that has run dry stands at the end of what it was sent. Of several places where it
    may stand (a contour that crosses itself) the earliest counts: a little is laid twice rather
    than left out.
    """
    if not after.has_begun:
        return RecoveryPlace(JOB_START, False, "nothing of the part had been begun")
    if after.is_place_exact:
        stands = position_mm is not None and _stands_at(job, after.proven_place, position_mm)
        return RecoveryPlace(after.proven_place, stands and after.is_position_kept,
                             "motion came to rest there, as journaled")
    if position_mm is not None:
        found = _on_lines_sent(job, after, np.asarray(position_mm[:3], dtype=np.float64))
        if found is not None:
            return RecoveryPlace(max(found, after.proven_place), after.is_position_kept,
                                 "the machine stands there")
    return RecoveryPlace(
        after.proven_place, False,
        "the machine does not stand on a line that was sent; this much the journal proves",
    )


def refuse_finished(job: JobReader, after: RunReplay, place: ProgramPlace,
                    motion: MotionSettings) -> None:
    """Raise JournalError where no bead is left to lay from a place on."""
    if place != JOB_START and plan_reentry(job.manifest, job.layer, place, motion) is None:
        raise JournalError(f"{after.run.run} has laid every bead of its job: nothing is left",
                           hint=f"`{after.run.command('log')}` prints its log")


def _on_lines_sent(job: JobReader, after: RunReplay,
                   position_mm: FloatArray) -> ProgramPlace | None:
    """The first place on the lines that may have been running where the machine may stand."""
    first = min(after.beam_on_line,
                after.proven_place.line) if after.beam_on_line else after.proven_place.line
    last = _last_before_next_path(job, after.last_line)
    for entry in job.manifest.layers:
        if entry.first_line + entry.n_lines <= first or entry.first_line > last:
            continue
        start_mm, end_mm = _lines_of(job, entry.index)
        rows = np.arange(len(end_mm)) + entry.first_line
        near = (rows >= first) & (rows <= last)
        share, off_mm = _nearest(start_mm[near], end_mm[near], position_mm)
        hits = np.flatnonzero(off_mm <= ON_LINE_MM)
        if len(hits):
            return ProgramPlace(int(rows[near][hits[0]]), float(share[hits[0]]))
    return None


def _stands_at(job: JobReader, place: ProgramPlace, position_mm: Sequence[float]) -> bool:
    """Whether the machine stands at a place."""
    index = layer_of(job.manifest, place.line)
    start_mm, end_mm = _lines_of(job, index)
    row = place.line - job.manifest.layers[index].first_line
    at_mm = start_mm[row] + place.line_fraction * (end_mm[row] - start_mm[row])
    return bool(np.linalg.norm(at_mm - np.asarray(position_mm[:3])) <= ON_LINE_MM)


def _nearest(
    start_mm: FloatArray, end_mm: FloatArray, position_mm: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Of each line the share at which it passes nearest to a point, and how far off."""
    along = end_mm - start_mm
    length2 = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", position_mm - start_mm, along)
    share = np.clip(np.divide(share, length2, out=np.ones_like(share), where=length2 > 0), 0, 1)
    off = position_mm - (start_mm + share[:, None] * along)
    return share, np.linalg.norm(off, axis=1)


def _lines_of(job: JobReader, index: int) -> tuple[FloatArray, FloatArray]:
    lines = job.layer(index).lines
    end_mm = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
    first = end_mm[:1] if index == 0 else _lines_of(job, index - 1)[1][-1:]
    return np.concatenate([first, end_mm[:-1]]), end_mm


def _last_before_next_path(job: JobReader, line: int) -> int:
    """The last line that can have been sent when no path after this line's had been begun."""
    manifest = job.manifest
    for entry in manifest.layers[layer_of(manifest, line):]:
        paths = job.layer(entry.index).lines["path"]
        rows = np.arange(len(paths)) + entry.first_line
        later = rows[(rows > line) & (paths >= 0)]
        if len(later):
            return int(later[0]) - 1
    return manifest.layers[-1].first_line + manifest.layers[-1].n_lines - 1

