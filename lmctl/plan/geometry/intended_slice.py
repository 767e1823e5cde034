"""The slice that tracks are to fill: the drawing, offset as the process specifies."""

from __future__ import annotations

from collections.abc import Sequence

from lmctl.array_types import FloatArray
from lmctl.config.part_file import ProcessSettings
from lmctl.field.outline_offset import offset_loops


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
    """The outline of the intended slice, from that of the drawing; loops as in `PartSection`."""
    return offset_loops(loops, outline_offset_mm(process))
