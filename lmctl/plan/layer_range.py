"""Which layers of a part can be deposited, and where the part stands for it.

`lmctl check` asks this without the rest of planning, so nothing else of it is imported here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import Process
from lmctl.errors import PlanError
from lmctl.plan.moves import LEAST_MOTION_MM, POSITION_STEP_MM
from lmctl.plan.tracks import Section, Track, in_plane_tracks, iso_3d_tracks
from lmctl.preflight.part_check import check_part
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: A track of less extent may, on the program's raster, hold no motion that a controller can make.
_LEAST_EXTENT_MM = 2 * (LEAST_MOTION_MM + POSITION_STEP_MM)


def place_layers(part: Part, profile: MachineProfile) -> Placement:
    """Where the layers of a part lie, all that can be laid.

    Layers at the bottom and at the top where nothing is as wide as a bead are left out; a part that
    the part file does not place is set down by what is left out below it.
    Raises PlanError: what `check_part` finds, or nothing as wide as a bead in any layer.
    """
    placement = check_part(part, profile)

    def has_tracks(layer: int) -> bool:
        return bool(tracks_of(part.section(placement.cut_mm(layer)), part.process))

    layers = range(placement.n_layers)
    first = next((layer for layer in layers if has_tracks(layer)), None)
    if first is None:
        raise PlanError(
            f"{part.name} has nothing as wide as a bead",
            where=f"process.bead_width_mm = {part.process.bead_width_mm:g}, "
                  f"strategy {part.process.strategy}",
            hint="take a finer bead, or check the units of the part")
    last = next(layer for layer in reversed(layers) if has_tracks(layer))
    return placement.only(first, last, set_down=part.placement_mm is None)


def tracks_of(section: Section, process: Process) -> list[Track]:
    """The tracks of a section by the process's strategy, those that can be moved along."""
    cut = in_plane_tracks if process.strategy == "in-plane" else iso_3d_tracks
    tracks = cut(section, process.bead_width_mm, process.bead_width_mm * (1 - process.overlap))
    return [t for t in tracks if np.ptp(t.points, axis=0).max() >= _LEAST_EXTENT_MM]
