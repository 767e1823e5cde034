"""The paper's literal reading: iso-contours of the 3D distance in a plane, nothing in between."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmctl.field.plane import iso_loops
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.polyline import densified_polyline

if TYPE_CHECKING:
    from lmctl.part.part import PartSection

#: Contours shorter than this part of a bead are left out.
_LEAST_LENGTH = 0.5


def iso_3d_tracks(section: PartSection, bead_mm: float, pitch_mm: float) -> list[Toolpath]:
    """Levels of the 3D distance at half a bead and every pitch; each strip is a pitch wide.

    Source: Zhou, Liu, Lu, Materials & Design 30 (2009) 939-946, contours Li(z), Eq. (9).
    """
    deepest = float(section.spatial_distance.max()) if section.spatial_distance.size else 0.0
    levels = np.arange(bead_mm / 2, deepest, pitch_mm)
    loops = iso_loops(section.spatial_distance, section.grid, levels)
    tracks = []
    for level in loops:
        for loop in level:
            fine = densified_polyline(loop, bead_mm / 10)
            track = Toolpath(fine, np.full(len(fine), pitch_mm), True)
            if track.length_mm >= _LEAST_LENGTH * bead_mm:
                tracks.append(track)
    return tracks
