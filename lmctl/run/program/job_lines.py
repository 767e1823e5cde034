"""The lines of a job as lengths and points, across its layers, for finding a place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.program.place import ProgramPlace
from lmctl.run.program.reentry import layer_of


@dataclass(frozen=True)
class LineRows:
    """Lines of one layer, one row a line. Arrays (n,), places (n, 3).

    line : counted through the whole job; path : -1 for none; speed_mm_s : programmed
    """

    layer: int
    line: NDArray[np.int64]
    path: NDArray[np.int32]
    is_bead: NDArray[np.bool_]
    start_mm: FloatArray
    end_mm: FloatArray
    speed_mm_s: FloatArray

    @property
    def length_mm(self) -> FloatArray:
        return np.asarray(np.linalg.norm(self.end_mm - self.start_mm, axis=1))

    def at_mm(self, row: int, share: float) -> FloatArray:
        return np.asarray(
            self.start_mm[row] + share * (self.end_mm[row] - self.start_mm[row]))


def rows_between(job: JobReader, first: int, last: int) -> Iterator[LineRows]:
    """The lines from first to last, both included, layer by layer."""
    for entry in job.manifest.layers[layer_of(job.manifest, first):]:
        if entry.first_line > last:
            return
        table = job.read_layer(entry.index).lines
        end_mm = np.column_stack([table["x_mm"], table["y_mm"], table["z_mm"]])
        start_mm = np.concatenate([_start_mm(job, entry.index, end_mm), end_mm[:-1]])
        line = np.arange(len(table)) + entry.first_line
        kept = (line >= first) & (line <= last)
        yield LineRows(
            entry.index, line[kept], table["path"][kept], table["kind"][kept] == LineKind.BEAD,
            start_mm[kept], end_mm[kept], table["speed_mm_s"][kept].astype(float),
        )


def bead_between_mm(job: JobReader, place: ProgramPlace, until: ProgramPlace) -> float:
    """Length of bead from one place to a later one."""
    return sum(float(lengths.sum()) for _, lengths in _bead_lengths(job, place, until))


def after_bead_mm(job: JobReader, place: ProgramPlace, until: ProgramPlace,
                  bead_mm: float) -> ProgramPlace:
    """The place that lies a bead length after another, but not after `until`."""
    for rows, lengths in _bead_lengths(job, place, until):
        done = np.cumsum(lengths)
        if bead_mm <= done[-1]:
            row = int(np.searchsorted(done, bead_mm))
            from_share = place.line_fraction if rows.line[row] == place.line else 0.0
            left_mm = bead_mm - (float(done[row - 1]) if row else 0.0)
            row_mm = float(rows.length_mm[row])
            return ProgramPlace(int(rows.line[row]),
                                from_share + (left_mm / row_mm if row_mm > 0 else 0.0))
        bead_mm -= float(done[-1])
    return until


def before_motion_mm(job: JobReader, place: ProgramPlace, motion_mm: float) -> ProgramPlace:
    """The place so much motion before another, with or without bead, within its layer."""
    entry = job.manifest.layers[layer_of(job.manifest, place.line)]
    (rows,) = rows_between(job, entry.first_line, place.line)
    share = place.line_fraction
    for row in range(len(rows.line) - 1, -1, -1):
        here_mm = float(rows.length_mm[row]) * share
        if here_mm >= motion_mm:
            if motion_mm > 0.0:
                share -= motion_mm / float(rows.length_mm[row])
            return ProgramPlace(int(rows.line[row]), share)
        motion_mm -= here_mm
        share = 1.0
    return ProgramPlace(entry.first_line)


def _bead_lengths(
    job: JobReader, place: ProgramPlace, until: ProgramPlace
) -> Iterator[tuple[LineRows, FloatArray]]:
    """Of each line between two places the length of bead that lies between them."""
    for rows in rows_between(job, place.line, until.line):
        share = np.ones(len(rows.line))
        share[rows.line == until.line] = until.line_fraction
        share[rows.line == place.line] -= place.line_fraction
        yield rows, np.where(rows.is_bead, np.maximum(share, 0.0) * rows.length_mm, 0.0)


def _start_mm(job: JobReader, layer: int, end_mm: FloatArray) -> FloatArray:
    """(1, 3) where a layer's first line starts; the job's first line is begun where it ends."""
    if layer == 0:
        return end_mm[:1]
    last = job.read_layer(layer - 1).lines[-1]
    return np.array([[last["x_mm"], last["y_mm"], last["z_mm"]]], dtype=np.float64)
