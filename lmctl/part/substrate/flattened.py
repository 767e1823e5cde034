"""A part on a substrate with a shape, in the coordinates (x, y, u) in which its layers are flat.

Planning then works as for a part on a plate: sections, tracks, overhangs and figures are those of
the flattened part. u is the level of `LayerStack`, z where the layers are level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.plane import PlaneGrid, section_loops
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import Body, plane_points
from lmctl.part.bodies.corners import restore_corners
from lmctl.part.bodies.measured import Bounds
from lmctl.part.materials.composition import CompositionField, UniformComposition
from lmctl.part.named_bodies import NamedBodies
from lmctl.part.part import Part
from lmctl.part.substrate.layer_stack import LayerStack
from lmctl.part.substrate.stack_choice import stack_of_part


@dataclass(frozen=True, eq=False)
class FlattenedBody(AnalyticBody):
    """A body in (x, y, u). Its distance is that of the body itself; a true distance in u only where
    layers are level."""

    body: Body
    stack: LayerStack
    bounds_mm: Bounds

    @property
    def tight_bounds_mm(self) -> Bounds:
        return self.bounds_mm

    @property
    def distance_bound_is_exact(self) -> bool:
        return False

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self.body.distance_at(self.stack.points_mm(points))

    def distance_bound(self, points: FloatArray) -> FloatArray:
        return self.body.distance_bound(self.stack.points_mm(points))

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """The gradient along the layer in x and y, and along u; not of length 1 on a slope."""
        level = float(points[0, 2]) if len(points) else 0.0
        gradient = self.body.inward_directions(self.stack.points_mm(points)).copy()
        rise = self.stack.slope(points[:, :2], level)
        gradient[:, :2] += gradient[:, 2:] * rise
        gradient[:, 2] *= self.stack.stretch(points[:, :2], level)
        return gradient

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return self.distance_at(plane_points(plane, z_mm)).astype(np.float32).reshape(plane.shape)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        if self.stack.is_level():
            return self.body.outline_loops(z_mm + self.stack.base_mm, plane)
        loops = section_loops(self.section_values(z_mm, plane), plane)
        return restore_corners(loops, z_mm, self.distance_bound, self.inward_directions)


@dataclass(frozen=True, eq=False)
class FlattenedComposition:
    """The composition of a body in (x, y, u)."""

    field: CompositionField
    stack: LayerStack

    def fractions(self, points: FloatArray) -> FloatArray:
        return self.field.fractions(self.stack.points_mm(points))


def flattened_part(part: Part) -> Part:
    """The part as it is planned: in (x, y, u), with its `layer_stack`.

    The part itself where its substrate is a level plate under it, or where it is flattened already.
    Raises PlanError where its layers cannot follow its substrate.
    """
    if part.substrate_surface is None or part.layer_stack is not None:
        return part
    process = part.process
    found = stack_of_part(
        part.substrate_surface, part.body, process.bead_width_mm, process.layer_height_mm)
    stack = found.stack
    low, high = (np.array(corner, dtype=np.float64) for corner in part.bounds_mm)
    low[2], high[2] = 0.0, found.highest_mm
    field = part.composition_field

    def flat(body: Body) -> FlattenedBody:
        return FlattenedBody(body, stack, (low, high))

    return replace(
        part, body=flat(part.body), layer_stack=stack,
        composition_field=field if isinstance(field, UniformComposition)
        else FlattenedComposition(field, stack),
        named_bodies=NamedBodies(tuple(
            (name, flat(body)) for name, body in part.named_bodies.bodies)),
        strategy_bodies={name: flat(body) for name, body in part.strategy_bodies.items()})
