"""Turn a measured field into a body: check that it is closed, remove specks, find its bounds.

Near a sharp edge or in a gap of a noisy scan single nodes can be off by a pitch or end on the wrong
side. These specks are far smaller than a bead, but each would become an outline of its own and
stretch the part's bounds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.array_storage import allocate_array

if TYPE_CHECKING:
    from lmctl.field.field import DistanceField

Bounds = tuple[FloatArray, FloatArray]

#: Islands and voids of fewer nodes than this (a cube of three) are taken for noise.
MIN_COMPONENT_NODES = 27


def remove_specks(field: DistanceField) -> tuple[DistanceField, int]:
    """The field with specks put on the side of what surrounds them, and how many there were.

    Only signs change: the distances around were measured to the same samples.
    """
    inside = field.values > 0
    values = field.values
    count = 0
    for side, sign in ((inside, -1.0), (~inside, 1.0)):
        specks, found = _small(side)
        if found:
            if count == 0:
                values = allocate_array(field.values.shape, field.values.dtype)
                values[:] = field.values
            count += found
            values[specks] = np.float32(sign) * np.abs(values[specks])
    return (replace(field, values=values) if count else field), count


def _small(side: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
    """Nodes of small components of one side, and the number of these; the largest always stays."""
    from scipy.ndimage import label  # late: only measured clouds need it

    labels, _ = label(side)
    sizes = np.bincount(labels.ravel())
    sizes[0] = MIN_COMPONENT_NODES
    small = sizes < MIN_COMPONENT_NODES
    if len(sizes) > 1:
        small[1 + int(np.argmax(sizes[1:]))] = False
    return small[labels], int(np.count_nonzero(small))


def is_closed(field: DistanceField) -> bool:
    """Whether the inside stays clear of the grid's faces, as that of a closed surface does."""
    v = field.values
    faces = (v[0], v[-1], v[:, 0], v[:, -1], v[:, :, 0], v[:, :, -1])
    return all(float(face.max()) < 0 for face in faces)


def zero_level_bounds(field: DistanceField, least_area_mm2: float = 0.0) -> Bounds:
    """Where a field's inside begins and ends along x, y, z.

    Each plane of nodes across an axis is given the highest level at which a connected patch of the
    least area remains; the outermost crossing of zero between planes is the bound. For a
    measured cloud this is the fitted surface: not its farthest stray point, nor a burr too small
    to be deposited.
    """
    least_nodes = max(1, round(least_area_mm2 / field.grid.pitch_mm**2))
    low, high = np.empty(3), np.empty(3)
    for axis in range(3):
        planes = np.moveaxis(field.values, 2 - axis, 0)
        places = field.grid.axis_mm(axis)
        low[axis] = _first_crossing(planes, places, least_nodes)
        high[axis] = _first_crossing(planes[::-1], places[::-1], least_nodes)
    return low, high


def _first_crossing(planes: NDArray[np.float32], places: FloatArray, least_nodes: int) -> float:
    """The place of the first plane with such a patch inside, moved back to where it is zero."""
    for needed in (least_nodes, 1):  # nowhere that wide: take any inside at all
        for index, plane in enumerate(planes):
            if (plane > 0).any() and (level := _patch_level(plane, needed)) > 0:
                if index == 0:
                    return float(places[0])
                before = _patch_level(planes[index - 1], needed)
                share = level / (level - before)
                return float(places[index] + share * (places[index - 1] - places[index]))
    raise ValueError("a field without inside has no bounds")


def _patch_level(plane: NDArray[np.float32], least_nodes: int) -> float:
    """The highest level (to a thousandth) above which so many nodes are connected."""
    if least_nodes == 1:
        return float(plane.max())
    from scipy.ndimage import label  # late: only measured clouds need it

    below, above = float(plane.min()), float(plane.max())
    while above - below > 1e-3 * max(1e-3, abs(above)):
        middle = 0.5 * (below + above)
        labels, count = label(plane > middle, structure=np.ones((3, 3)))
        largest = int(np.bincount(labels.ravel())[1:].max()) if count else 0
        if largest >= least_nodes:
            below = middle
        else:
            above = middle
    return below
