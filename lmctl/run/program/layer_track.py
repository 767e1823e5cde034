"""One layer of a job as a polyline: lengths, times and kinds by line, and points between lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.job.schema import JobLayer, LineKind
from lmctl.run.program.approach import axis_limit_along

#: A shorter move gets no line: the firmware makes no block of less than a motor step [mm].
MIN_MOVE_MM = 0.02


@dataclass(frozen=True)
class TrackPoint:
    """A point on a row of a layer. row : index into its lines; share : of the row's length."""

    row: int
    share: float


class LayerTrack:
    """One layer as a polyline, from where the machine is at its first line."""

    def __init__(self, layer: JobLayer, start_mm: FloatArray) -> None:
        lines = layer.lines
        self.layer = layer
        self.kind, self.path = lines["kind"], lines["path"]
        self.end_mm = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
        self.start_mm = np.concatenate([start_mm[None], self.end_mm[:-1]])
        self.length_mm = np.linalg.norm(self.end_mm - self.start_mm, axis=1)
        self.end_s = lines["end_s"]
        self.start_s = np.concatenate([layer.flow_s[:1], self.end_s[:-1]])

    def acceleration(self, row: int, motion: MotionSettings) -> float:
        """Along a row [mm/s²]."""
        away_mm = self.end_mm[row] - self.start_mm[row]
        if not away_mm.any():
            return min(motion.acceleration_mm_s2)
        return axis_limit_along(motion.acceleration_mm_s2, away_mm)

    def next_bead(self, row: int, share: float) -> int | None:
        """The first row from here on with bead left to deposit."""
        if row < len(self.kind) and self.length_mm[row] * (1.0 - share) < MIN_MOVE_MM:
            row += 1
        beads = np.flatnonzero(self.kind[row:] == LineKind.BEAD)
        return row + int(beads[0]) if len(beads) else None

    def first_of_path(self, row: int) -> int:
        while row > 0 and self.path[row - 1] == self.path[row]:
            row -= 1
        return row

    def back(self, point: TrackPoint, by_mm: float, first_row: int) -> TrackPoint:
        """The point so much further back along the lines, but not before a row's start."""
        row, share = point.row, point.share
        while True:
            here_mm = self.length_mm[row] * share
            if here_mm >= by_mm:
                return TrackPoint(row, share - by_mm / self.length_mm[row] if by_mm else share)
            if row == first_row:
                return TrackPoint(row, 0.0)
            by_mm -= here_mm
            row, share = row - 1, 1.0

    def at_mm(self, point: TrackPoint) -> FloatArray:
        start = self.start_mm[point.row]
        return np.asarray(start + point.share * (self.end_mm[point.row] - start))

    def at_s(self, point: TrackPoint) -> float:
        start_s = float(self.start_s[point.row])
        return start_s + point.share * (float(self.end_s[point.row]) - start_s)

    def between_mm(self, before: TrackPoint, after: TrackPoint) -> float:
        """Path length from one point to a later one."""
        between_rows_mm = float(self.length_mm[before.row : after.row].sum())
        return (between_rows_mm - before.share * float(self.length_mm[before.row])
                + after.share * float(self.length_mm[after.row]))
