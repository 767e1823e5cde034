"""The outline of bodies made one does not stop where they join.

On a face that two bodies share each of them is at 0, and so is their union by formula, which would
leave a slit there for every outline to run into. Nodes on a joint take the side that is all around
them. Nodes beside the outline that are near a joint take the distance from what is left of the
bodies' surfaces: measured to the joint they would notch the outline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.field.plane import PlaneGrid
from lmctl.part.booleans.local_sides import LocalSides

FloatArray = NDArray[np.float64]
Plane = NDArray[np.float32]


def remove_shared_faces(
    rows: Sequence[Plane], cells: LocalSides, at: Callable[[FloatArray], FloatArray], z_mm: float,
    plane: PlaneGrid,
) -> Plane:
    """The cut of bodies made one by those of its leaves, without what these hide from each other.

    rows : (ny, nx) float32 [mm] of each leaf, positive inside
    cells : of the body; at : its distance
    """
    formula: Plane = cells.expression.evaluate(rows)
    values = formula.copy()
    on_it = np.abs(values) <= cells.shared_face_tolerance_mm
    if on_it.any():
        places = _places(on_it, z_mm, plane)
        values[on_it] = cells.depth_on_shared_faces(places, values[on_it].astype(np.float64))
    # A node is a step from the outline at most; a leaf farther from it by more hides nothing.
    reach = np.abs(formula) + np.float32(plane.pitch_mm)
    near = np.zeros(formula.shape, dtype=np.int32)
    for row in rows:
        near += np.abs(row) <= reach
    doubted = _beside_outline(values > 0) & (near > 1)
    if doubted.any():
        depth = np.abs(at(_places(doubted, z_mm, plane)))
        values[doubted] = np.copysign(np.maximum(depth, np.abs(values[doubted])), values[doubted])
    return values


def _places(chosen: NDArray[np.bool_], z_mm: float, plane: PlaneGrid) -> FloatArray:
    """The chosen nodes (ny, nx) as points (n, 3) [mm]."""
    y, x = np.nonzero(chosen)
    return np.column_stack([plane.x_mm[x], plane.y_mm[y], np.full(len(x), float(z_mm))])


def _beside_outline(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The nodes one of whose four neighbours is on the other side."""
    beside = np.zeros_like(inside)
    across, along = inside[:, 1:] != inside[:, :-1], inside[1:] != inside[:-1]
    beside[:, 1:] |= across
    beside[:, :-1] |= across
    beside[1:] |= along
    beside[:-1] |= along
    return beside
