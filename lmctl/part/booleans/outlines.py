"""The outline of bodies made one, from the outlines of its leaves.

What lies between two outlines may be thinner than any raster: a shell, a wall that a difference
leaves. So outlines are not read off the values of the result at nodes. They are cut with each other
as polygons (manifold3d, to 1e-8 mm), each as exact as its own body gives it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.plane import PlaneGrid, loop_area_mm2, section_loops
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.corners import restore_corners
from lmctl.part.booleans.expression import BooleanExpression, Formula, SignedLeaf

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: Slits up to this wide between outlines that follow one surface are closed, in pitches: outlines
#: of curved bodies are chords between the nodes of a plane.
SLIT_PITCHES = 0.01


def combined_outline(
    expression: BooleanExpression, z_mm: float, plane: PlaneGrid, slit_mm: float
) -> list[FloatArray]:
    """The outline at height z: closed loops (k, 2) float64 [mm], the inside on the left.

    slit_mm : slits up to this wide are rounding of the leaves, and are closed, too
    """
    from manifold3d import JoinType

    region, inverted = _region(
        expression.formula, [_outline(leaf, z_mm, plane) for leaf in expression.leaves])
    assert not inverted, "loading refuses a part without end"
    if region.is_empty():
        return []
    close = max(SLIT_PITCHES * plane.pitch_mm, slit_mm)
    region = region.offset(close, JoinType.Miter, 3.0).offset(-close, JoinType.Miter, 3.0)
    loops = [np.vstack([polygon, polygon[:1]]) for polygon in region.to_polygons()]
    return [loop for loop in loops if not _is_sliver(loop, close)]


def _outline(leaf: Body, z_mm: float, plane: PlaneGrid) -> CrossSection:
    """A leaf's own outline; of one that leaves the plane, what of it is in the plane."""
    from manifold3d import CrossSection, FillRule

    try:
        loops = leaf.outline_loops(z_mm, plane)
    except InputError:  # it reaches the edge of the plane, which the part does not
        values = leaf.section_values(z_mm, plane).copy()
        for edge in (values[0], values[-1], values[:, 0], values[:, -1]):
            np.minimum(edge, np.float32(-0.5 * plane.pitch_mm), out=edge)
        loops = restore_corners(section_loops(values, plane), z_mm, leaf.distance_bound,
                             leaf.inward_directions)
    return CrossSection([loop[:-1] for loop in loops], FillRule.EvenOdd)


def _region(
    formula: Formula, outlines: Sequence[CrossSection]
) -> tuple[CrossSection, bool]:
    """What a formula leaves, or (True) what it leaves out."""
    if isinstance(formula, SignedLeaf):
        return outlines[formula.leaf], formula.sign < 0
    from manifold3d import CrossSection, OpType

    parts = [_region(part, outlines) for part in formula.operands]
    solid = [region for region, inverted in parts if not inverted]
    without = [region for region, inverted in parts if inverted]
    some, others = (solid, without) if formula.requires_all else (without, solid)
    # Of an intersection: all of some, less any of the others. A union is that, inside out.
    if not some:
        return CrossSection.batch_boolean(others, OpType.Add), formula.requires_all
    common = CrossSection.batch_boolean(some, OpType.Intersect)
    if others:
        common = common - CrossSection.batch_boolean(others, OpType.Add)
    return common, not formula.requires_all


def _is_sliver(loop: FloatArray, width_mm: float) -> bool:
    around = float(np.linalg.norm(np.diff(loop, axis=0), axis=1).sum())
    return abs(loop_area_mm2(loop)) < 0.5 * width_mm * around
