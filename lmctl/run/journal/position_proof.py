"""Places where a machine may be that has run only the lines sent, and what they prove.

A controller that was power-cycled reports 0, 0, 0; a machine moved by hand reports another place.
The position is proven only where the machine is on a move that was sent according to the
journal. That also proves how far the job has been executed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.job.reader import JobReader
from lmctl.run.journal.position_history import way_to_purge_mm
from lmctl.run.journal.replay import RunReplay
from lmctl.run.program.job_lines import rows_between
from lmctl.run.program.place import ProgramPlace
from lmctl.run.program.reentry import layer_of, plan_reentry

#: A machine this near to a move that was sent is on it [mm]: steps and rounding are finer.
ON_LINE_MM = 0.05

#: A machine that has not moved since it was reported at rest reports the same place [mm].
SAME_MM = 0.002


@dataclass(frozen=True)
class PositionProof:
    """What explains the position of a machine.

    is_unmoved : it is exactly where it was last reported at rest, and was sent nowhere since
    places : up to where the job may have been executed if it is there, ascending: more than
        one where the path comes by the same point again; empty where nothing explains it
    """

    is_unmoved: bool
    places: tuple[ProgramPlace, ...]

    @property
    def is_explained(self) -> bool:
        return bool(self.places)


def position_proof(
    job: JobReader, after: RunReplay, motion: MotionSettings, position_mm: Sequence[float]
) -> PositionProof:
    """What explains a machine position, in program coordinates."""
    at_mm = np.asarray(position_mm[:3], dtype=np.float64)
    is_unmoved = (
        after.standstill_mm is not None and not after.to_purge and not after.moving
        and _off_mm(after.standstill_mm, at_mm) <= SAME_MM
    )
    places = _on_lines_sent(job, after, at_mm) if after.moving else []
    if _near(_before_the_job(job, after, motion), at_mm):
        places.append(after.proven_place)
    proven = {max(place, after.proven_place) for place in places}
    return PositionProof(is_unmoved, tuple(sorted(proven)))


def _on_lines_sent(job: JobReader, after: RunReplay, at_mm: FloatArray) -> list[ProgramPlace]:
    """The places on the lines that may have been executed where the machine may be.

    Lines that were journaled as sent come first. A host whose power failed may have lost the last
    of these records, but never the record of a path.
    """
    proven = after.proven_place.line
    first = min(after.beam_on_line, proven) if after.beam_on_line else proven
    sent = _hits(job, first, after.sent_line, at_mm)
    return sent or _hits(job, first, _last_before_next_path(job, after.last_line), at_mm)


def _hits(job: JobReader, first: int, last: int, at_mm: FloatArray) -> list[ProgramPlace]:
    found = []
    for rows in rows_between(job, first, last):
        share, off_mm = _nearest(rows.start_mm, rows.end_mm, at_mm)
        found += [
            ProgramPlace(int(rows.line[row]), float(share[row]))
            for row in np.flatnonzero(off_mm <= ON_LINE_MM)
        ]
    return found


def _before_the_job(job: JobReader, after: RunReplay, motion: MotionSettings) -> list[FloatArray]:
    """The moves it was sent that deposit nothing, as polylines: from its position to the purge
    position, and from there to the path."""
    high = np.array([*motion.purge_mm[:2], motion.travel_mm.z[1]])
    lines: list[FloatArray] = []
    if after.standstill_mm is not None:
        lines.append(np.array([after.standstill_mm[:3]] * 2, dtype=np.float64))
    if after.to_purge:
        lines.append(np.array([high, motion.purge_mm]))
        if after.standstill_mm is not None:
            lines.append(way_to_purge_mm(after.standstill_mm, motion))
    if after.moving and after.entered_at is not None:
        entry = plan_reentry(job.manifest, job.read_layer, after.entered_at, motion)
        if entry is not None:
            approach = entry.layer.lines[: entry.beam_on_line - entry.layer.first_line]
            lines.append(np.column_stack([approach["x_mm"], approach["y_mm"], approach["z_mm"]]))
    return lines


def _near(polylines: Sequence[FloatArray], at_mm: FloatArray) -> bool:
    return any(
        bool((_nearest(line[:-1], line[1:], at_mm)[1] <= ON_LINE_MM).any()) for line in polylines
    )


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


def _off_mm(one: Sequence[float], other: FloatArray) -> float:
    return float(np.linalg.norm(np.asarray(one[:3], dtype=np.float64) - other))


def _last_before_next_path(job: JobReader, line: int) -> int:
    """The last line that can have been sent when no path after this line's had been begun."""
    manifest = job.manifest
    for entry in manifest.layers[layer_of(manifest, line):]:
        paths = job.read_layer(entry.index).lines["path"]
        rows = np.arange(len(paths)) + entry.first_line
        later = rows[(rows > line) & (paths >= 0)]
        if len(later):
            return int(later[0]) - 1
    return manifest.layers[-1].first_line + manifest.layers[-1].n_lines - 1
