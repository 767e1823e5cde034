"""Reduce starts: join neighbouring closed tracks into one, and open tracks to them.

Two closed tracks side by side become one where a stretch of each is replaced by two bridges: the
nozzle leaves the first, goes all round the second and comes back. The stretches are as long as the
bridges, so what is deposited stays the same. All closed tracks of a region so become one (a
spanning tree of bridges). An open track goes on into a closed one that it ends beside, or into
another open one.

Bridges are short, stay inside the material, join equal mixtures, and lie where the seam would be.
"""

from __future__ import annotations

from lmctl.plan.geometry.link_ends import joined_at_ends
from lmctl.plan.geometry.link_lines import LinkableTrack, LinkRules
from lmctl.plan.geometry.link_loops import merged_loops
from lmctl.plan.geometry.link_places import BridgePlaces
from lmctl.plan.geometry.section_raster import SectionRaster


def linked_tracks(
    lines: list[LinkableTrack], raster: SectionRaster, rules: LinkRules,
    places: BridgePlaces | None = None,
) -> list[LinkableTrack]:
    """The same deposit in fewer tracks.

    places : where closed lines may be joined, if that is known; rows count closed lines first
    """
    if len(lines) < 2:
        return lines
    loops = [line for line in lines if line.is_closed]
    merged = merged_loops(loops, [line for line in lines if not line.is_closed], raster, rules,
                          places)
    return joined_at_ends(merged, raster, rules)
