"""Mixtures that put the most of each bead within the tolerance, once the order of beads is known.

A bead is of one mixture across its width, and what it should become is not: the part changes across
it, and where it lies upon the side of another bead of its layer it melts that, not what lies below.
So the mixture to feed is sought for the columns that the bead is poured into, each with what the
bead melts there and what the part is there. Not their mean is taken, which a bead's sides would
pull away from its middle, but the mixture that is right for the most of its volume.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel
from lmctl.plan.dilution.fed_mixtures import projected_to_mixtures
from lmctl.plan.dilution.poured_columns import LaidColumns, pour
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.track_order import OrderedTracks

#: Mixtures change along a bead no faster than over its own width: so far to both sides they are
#: averaged, in beads.
_AVERAGED_BEADS = 0.5
#: Most that a mixture is moved from the one that is right in the mean, as a volume fraction: half
#: of the tolerance of a path. The steps of mixture along a bead take up to the other half.
_MOST_MOVED = 0.01


def fitted_mixtures(
    tracks: OrderedTracks, recipe: Recipe, before: LaidColumns | None
) -> OrderedTracks:
    """The tracks of a layer with the mixtures to feed, and what they then melt.

    before : what lies on top of the layer below, where that is known
    Tracks whose dilution is not compensated come back as they are.
    """
    melted = tracks.melted
    if melted is None or melted.designed_across is None or tracks.n_tracks == 0:
        return tracks
    found = pour(
        tracks.points_mm, tracks.starts, recipe.bead_mm,
        tracks.strip_width_mm * recipe.layer_height_mm, melted.share, melted.below,
        tracks.fractions, melted.designed_across, before)
    moved = found.fed - found.even
    most = np.abs(moved).max(axis=1, initial=0.0)
    moved *= np.minimum(1.0, _MOST_MOVED / np.maximum(most, 1e-12))[:, None]
    reach_mm = _AVERAGED_BEADS * recipe.bead_mm
    fed = projected_to_mixtures(
        _averaged(found.even + moved, tracks.along_mm, tracks.starts, reach_mm))
    below = np.asarray(_averaged(found.melted, tracks.along_mm, tracks.starts, reach_mm))
    return replace(tracks, fractions=fed, melted=replace(melted, below=below))


def laid_columns(
    beads: Beads, tracks: OrderedTracks, recipe: Recipe, before: LaidColumns | None
) -> LaidColumns | None:
    """What lies on top once a layer's beads are deposited, with what hoppers can meter of them."""
    if tracks.melted is None or tracks.melted.designed_across is None:
        return None
    melted: MeltedBelow = tracks.melted.at_lengths(tracks.along_mm, beads.along_mm)
    section = beads.width_mm * (recipe.pitch_mm / recipe.bead_mm) * recipe.layer_height_mm
    return pour(beads.points_mm, beads.starts, recipe.bead_mm, section, melted.share, melted.below,
                beads.fractions, None, before).laid


@kernel
def _averaged(
    values: FloatArray, along_mm: FloatArray, starts: IndexArray, reach_mm: float
) -> FloatArray:
    """Means over what is no farther along its track, by length, (n, k)."""
    averaged = np.empty_like(values)
    for track in range(len(starts) - 1):
        first, end = starts[track], starts[track + 1]
        low = first
        for v in range(first, end):
            while along_mm[low] < along_mm[v] - reach_mm:
                low += 1
            total = 0.0
            for c in range(values.shape[1]):
                averaged[v, c] = 0.0
            k = low
            while k < end and along_mm[k] <= along_mm[v] + reach_mm:
                before = along_mm[k] - along_mm[max(k - 1, first)]
                after = along_mm[min(k + 1, end - 1)] - along_mm[k]
                weight = 0.5 * (before + after) + 1e-9
                total += weight
                for c in range(values.shape[1]):
                    averaged[v, c] += weight * values[k, c]
                k += 1
            for c in range(values.shape[1]):
                averaged[v, c] /= total
    return averaged
