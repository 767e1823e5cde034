"""Powder along a path, and what it melts from below by the dilution that its job believes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray

if TYPE_CHECKING:
    from lmctl.job.reader import JobReader
    from lmctl.part.part import Part


def with_melted_below(
    delivered: FloatArray, under_mm: FloatArray, part: Part, job: JobReader, layer_mm: float,
    materials: tuple[str, ...],
) -> FloatArray:
    """Mixtures (n, materials) of beads from those of their powder at places `under_mm` (n, 3).

    Unchanged for a job that feeds the part's own mixtures, and in a first layer that does so
    because its substrate is not known. What lies below is taken to be as designed; where it is not,
    by as much as could not be made up for, the result is off by δ times that.

    under_mm : middles of their layers, in the part's own coordinates
    materials : names of the columns; the substrate's is the last where it is none of the part's
    """
    believed = job.manifest.totals.get("dilution")
    if not believed or not believed["compensated_fraction"]:
        return delivered
    below = np.zeros_like(delivered)
    below[:, : len(part.materials)] = part.composition(under_mm - [0.0, 0.0, layer_mm])
    first_z_mm = job.manifest.layers[0].z_mm - job.manifest.part_offset_mm[2]
    on_substrate = under_mm[:, 2] < first_z_mm
    share = np.full(len(delivered), float(believed["share"]))
    alloy = part.substrate.material
    if alloy is None:
        share[on_substrate] = 0.0
    else:
        below[on_substrate] = 0.0
        of = materials.index(alloy) if alloy in materials else len(part.materials)
        if of < len(materials):  # else the build knows no other alloy: its share is missing
            below[on_substrate, of] = 1.0
    return np.asarray(delivered + share[:, None] * (below - delivered))
