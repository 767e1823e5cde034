"""What beads are of, from their powder and the dilution that their job believes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from lmctl.array_types import FloatArray

if TYPE_CHECKING:
    from lmctl.job.reader import JobReader
    from lmctl.part.part import Part


@dataclass(frozen=True)
class LevelDilution:
    """Dilution of layers that are put down one upon the other.

    share : δ; substrate : (materials + 1,) of the part and one foreign; None where it is not known,
        and the first layer is of its powder
    """

    share: float
    substrate: FloatArray | None

    @classmethod
    def of_job(cls, job: JobReader, part: Part) -> Self | None:
        """What a job believes; None where it makes up for nothing."""
        believed = job.manifest.totals.get("dilution")
        if not believed or not believed["compensated_fraction"]:
            return None
        names = [material.name for material in part.materials]
        alloy, substrate = part.substrate.material, None
        if alloy is not None:
            substrate = np.zeros(len(names) + 1)
            substrate[names.index(alloy) if alloy in names else -1] = 1.0
        return cls(float(believed["share"]), substrate)

    def melted_into(self, volumes: FloatArray) -> FloatArray:
        """Volumes (materials + 1, nx, ny, levels) as they are once each has melted what is below
        it in its column; sums of all materials stay."""
        found = np.zeros_like(volumes)
        below = np.full(volumes.shape[:3], np.nan)
        if self.substrate is not None:
            below[:] = self.substrate[:, None, None]
        for level in range(volumes.shape[3]):
            total = volumes[..., level].sum(axis=0)
            filled = total > 0
            if not filled.any():
                continue
            mixture = volumes[..., level][:, filled] / total[filled]
            under = below[:, filled]
            mixture += self.share * np.where(np.isnan(under), 0.0, under - mixture)
            found[..., level][:, filled] = mixture * total[filled]
            below[:, filled] = mixture
        return found


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
    if part.substrate_surface is not None:  # the first layer is no height, but the lowest over it
        heights = part.substrate_surface.heights
        on_substrate = under_mm[:, 2] - heights.height_mm(under_mm[:, :2]) < layer_mm
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
