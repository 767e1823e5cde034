"""The alloy of the substrate, as a mixture of the part's materials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray

if TYPE_CHECKING:
    from lmctl.part.part import Part


def substrate_mixture(part: Part) -> FloatArray | None:
    """Share of each of the part's materials in its substrate, and last that of a foreign alloy,
    (materials + 1,); None where its alloy is not stated."""
    alloy = part.substrate.material
    if alloy is None:
        return None
    names = [material.name for material in part.materials]
    mixture = np.zeros(len(names) + 1)
    mixture[names.index(alloy) if alloy in names else -1] = 1.0
    return mixture
