"""Where along the middle of an island something else than contours is laid, piece by piece."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.medial import MedialAxis
from lmctl.plan.polyline import arc_lengths
from lmctl.plan.spacing import Centrelines

#: A line that runs into no other track is laid from this part of a bead on; below, it is a point.
_LEAST_ALONE = 0.125


def replacing(
    axis: MedialAxis, mine: NDArray[np.bool_], middle: Centrelines, bead_mm: float
) -> list[NDArray[np.intp]]:
    """Chains of the medial axis along which something else than contours is laid.

    One shorter than a/2 is left to the contours it runs into; one that runs into none is laid
    unless it is hardly more than a point.
    """
    here = middle.runs | middle.parts
    beside = np.zeros(len(axis.points), dtype=np.bool_)
    leaving = axis.edges[mine & middle.wide[axis.edges].any(axis=1)]
    beside[leaving] = True
    chosen = []
    for chain in axis.chains(mine & here[axis.edges].all(axis=1)):
        alone = middle.slim[chain].all() and not beside[chain].any()
        least_mm = bead_mm * (_LEAST_ALONE if alone else 0.5)
        if arc_lengths(axis.points[chain])[-1] >= least_mm:
            chosen.append(chain)
    return chosen


def pieces(
    chain: NDArray[np.intp], axis: MedialAxis, middle: Centrelines, least_mm: float
) -> list[tuple[NDArray[np.intp], bool]]:
    """A chain cut where one track becomes two, and whether there are two; pieces not too short.

    Where the width is just at the limit, rounding alone would cut it to shreds.
    """
    along = arc_lengths(axis.points[chain])
    two = middle.parts[chain].copy()
    while True:
        cuts = np.concatenate([[0], np.flatnonzero(np.diff(two)) + 1, [len(chain) - 1]])
        lengths = np.diff(along[cuts])
        shortest = int(np.argmin(lengths))
        if len(lengths) == 1 or lengths[shortest] >= least_mm:
            break
        last = cuts[shortest + 1] + (shortest == len(lengths) - 1)
        two[cuts[shortest] : last] ^= True
    return [(chain[a : b + 1], bool(two[a])) for a, b in pairwise(cuts)]
