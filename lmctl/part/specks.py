"""Specks of a measured field: islands and voids of a few nodes, where samples were ambiguous.

Near a sharp edge of a noisy scan single nodes can end on the wrong side. They are far smaller than
a bead, but each would become an outline of its own and stretch the part's bounds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from lmctl.field.field import Field

#: Islands and voids of fewer nodes than this (a cube of three) are taken for noise.
FEWEST_NODES = 27


def without_specks(field: Field) -> tuple[Field, int]:
    """The field with specks put on the side of what surrounds them, and how many there were.

    Only signs change: the distances around were measured to the same samples.
    """
    inside = field.values > 0
    values = field.values
    count = 0
    for side, sign in ((inside, -1.0), (~inside, 1.0)):
        specks, found = _small(side)
        if found:
            count += found
            values = np.where(specks, np.float32(sign) * np.abs(field.values), values)
    return (replace(field, values=values) if count else field), count


def _small(side: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """Nodes of small components of one side, and the number of these; the largest always stays."""
    labels, _ = ndimage.label(side)
    sizes = np.bincount(labels.ravel())
    sizes[0] = FEWEST_NODES
    small = sizes < FEWEST_NODES
    if len(sizes) > 1:
        small[1 + int(np.argmax(sizes[1:]))] = False
    return small[labels], int(np.count_nonzero(small))
