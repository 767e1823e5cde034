"""What beads melt of the layer below, along the tracks of a layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True)
class MeltedBelow:
    """What beads melt of what lies below them, at n vertices.

    designed : (n, materials + 1) float64, the part's composition, 0 of a foreign substrate
    below : (n, materials + 1) float64, what is melted
    share : (n,) float64, δ
    designed_across : (n, places, materials) float64, the part's composition across the bead, from
        its right edge to its left; None where that is not known
    """

    designed: FloatArray
    below: FloatArray
    share: FloatArray
    designed_across: FloatArray | None = None

    def at_vertices(self, index: IndexArray, turned: BoolArray | None = None) -> MeltedBelow:
        """The same of other vertices, by their numbers (k,). turned : (k,) whose tracks are
        deposited from their last vertex to their first"""
        across = None if self.designed_across is None else self.designed_across[index]
        if across is not None and turned is not None:
            across[turned] = across[turned, ::-1]
        return MeltedBelow(self.designed[index], self.below[index], self.share[index], across)

    def at_lengths(self, along_mm: FloatArray, at_mm: FloatArray) -> MeltedBelow:
        """The same at places (q,) of lengths `along_mm` (n,) of the vertices, linear in between,
        without what it is across."""
        def at(columns: FloatArray) -> FloatArray:
            return np.column_stack([np.interp(at_mm, along_mm, one) for one in columns.T])

        return MeltedBelow(at(self.designed), at(self.below),
                           np.interp(at_mm, along_mm, self.share))

    def laid(self, fed: FloatArray) -> FloatArray:
        """What beads are of that are fed with mixtures (n, materials): (n, materials + 1)."""
        fed = np.column_stack([fed, np.zeros(len(fed))])
        return np.asarray(fed + self.share[:, None] * (self.below - fed))
