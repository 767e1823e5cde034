"""The slice that tracks are to fill: the drawing, offset as the process specifies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.part_file import ProcessSettings
from lmctl.field.outline_offset import offset_loops

#: A vertex lies on a straight edge if it is off by less than this, far below any machine's step.
_STRAIGHT_MM = 1e-9


def pitch_mm(process: ProcessSettings) -> float:
    """Nominal distance of neighbouring tracks."""
    return process.bead_width_mm * (1 - process.overlap)


def outline_offset_mm(process: ProcessSettings) -> float:
    """How far the intended outline lies outside the drawing; negative: inside.

    A track fills a strip a pitch wide around it. With `outer_track = "half-bead"` the outermost
    lies half a bead inside the drawing, so its strip ends inside it.
    """
    inset = 0.0
    if process.outer_track == "half-bead":
        inset = (process.bead_width_mm - pitch_mm(process)) / 2
    return process.allowance_mm - inset


def intended_loops(loops: Sequence[FloatArray], process: ProcessSettings) -> list[FloatArray]:
    """The outline of the intended slice, from that of the drawing; loops as in `PartSection`.

    A mesh is cut at every edge of its triangles, also where a flat wall is made of several, and
    elsewhere in each layer. Without those vertices straight walls have one outline in all layers.
    """
    return offset_loops([without_straight_vertices(loop) for loop in loops],
                        outline_offset_mm(process))


def without_straight_vertices(loop: FloatArray) -> FloatArray:
    """A closed loop (k, 2) [mm] without the vertices that lie on straight edges.

    It begins at its lowest vertex of those farthest left, wherever it began.
    """
    points = loop[:-1]
    ahead, behind = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
    cross = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
    along = ahead[:, 0] * behind[:, 0] + ahead[:, 1] * behind[:, 1]
    straight = (along > 0) & (np.abs(cross) <= _STRAIGHT_MM * np.sqrt(np.abs(along)))
    corners = points[~straight]
    if len(corners) < 3:
        return loop
    corners = np.roll(corners, -int(np.lexsort((corners[:, 1], corners[:, 0]))[0]), axis=0)
    return np.vstack([corners, corners[:1]])
