"""The slice that tracks are to fill: the drawing, moved as the process says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.config.part_file import ProcessSettings
from lmctl.field.plane import iso_loops
from lmctl.plan.geometry.section_raster import raster_pitch_mm, section_raster

FloatArray = NDArray[np.float64]


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
    """The outline of the intended slice, from that of the drawing; loops as `Section` has them."""
    offset = outline_offset_mm(process)
    if offset == 0 or not loops:
        return list(loops)
    node = raster_pitch_mm(process.bead_width_mm, pitch_mm(process))
    room = max(offset, 0.0) + 2 * node
    points = np.vstack(loops)
    box = np.array([points.min(axis=0) - room, points.max(axis=0) + room])
    raster = section_raster(loops, node, box)
    return iso_loops(raster.depth_mm, raster.grid, [-offset])[0]
