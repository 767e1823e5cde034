"""The copies of a part on its plate, and where they stand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.copies import CopySettings, copy_names

if TYPE_CHECKING:
    from lmctl.part.part import Part


@dataclass(frozen=True)
class PartCopy:
    """One copy: the part turned about its own z axis, then moved in the plane.

    name : or serial number
    position_mm : (x, y) of the part's own origin, in coordinates that all copies share
    turn_deg : counter-clockwise seen from above
    """

    name: str
    position_mm: tuple[float, float]
    turn_deg: float

    @property
    def rotation(self) -> FloatArray:
        """(2, 2), of column vectors."""
        angle = math.radians(self.turn_deg)
        cosine, sine = math.cos(angle), math.sin(angle)
        if self.turn_deg % 90 == 0:  # so that quarter turns are exact
            cosine, sine = round(cosine), round(sine)
        return np.array([[cosine, -sine], [sine, cosine]], dtype=np.float64)

    def places_mm(self, places_mm: FloatArray) -> FloatArray:
        """Places (n, 2) of the part, in the shared coordinates."""
        return np.asarray(places_mm @ self.rotation.T + np.array(self.position_mm))

    def own_places_mm(self, places_mm: FloatArray) -> FloatArray:
        """Places (n, 2) in the shared coordinates, in the part's own."""
        return np.asarray((places_mm - np.array(self.position_mm)) @ self.rotation)


def copies_of(settings: tuple[CopySettings, ...]) -> tuple[PartCopy, ...]:
    """All copies in order, with their names."""
    names = iter(copy_names(settings))
    copies = []
    for one in settings:
        step_x, step_y = one.spacing_mm or (0.0, 0.0)
        for row in range(one.count[1]):
            for column in range(one.count[0]):
                x, y = one.position_mm
                copies.append(PartCopy(next(names), (x + column * step_x, y + row * step_y),
                                       one.turn_deg))
    return tuple(copies)


def bounds_of_copies_mm(part: Part) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest x, y, z of all copies in the shared coordinates, each (3,) float64.

    Of turned copies boxes are turned, so that the part may be smaller. Those of the part itself
    where it has no copies.
    """
    low, high = (np.asarray(corner, dtype=np.float64) for corner in part.bounds_mm)
    if not part.copies:
        return low, high
    corners = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    places = np.vstack([copy.places_mm(corners) for copy in part.copies])
    return (np.array([*places.min(axis=0), low[2]]), np.array([*places.max(axis=0), high[2]]))


def composition_of_copies(part: Part) -> Callable[[FloatArray], FloatArray]:
    """The composition at points (n, 3) in the shared coordinates -> (n, materials).

    Each point belongs to the copy whose box it is in, or nearest to. The part's own without copies.
    """
    if not part.copies:
        return part.composition
    low, high = (np.asarray(corner, dtype=np.float64)[:2] for corner in part.bounds_mm)

    def composition(points_mm: FloatArray) -> FloatArray:
        least = np.full(len(points_mm), np.inf)
        own = np.array(points_mm, dtype=np.float64)
        for copy in part.copies:
            places = copy.own_places_mm(points_mm[:, :2])
            beside = np.maximum(low - places, places - high).max(axis=1)
            nearer = beside < least
            least[nearer] = beside[nearer]
            own[nearer, :2] = places[nearer]
        return part.composition(own)

    return composition


def part_in_place(part: Part, copy: PartCopy) -> Part:
    """A copy as a part of its own, in the shared coordinates."""
    from lmctl.part.bodies.transformed import SimilarityTransform, TransformedBody
    from lmctl.part.materials.composition import TransformedComposition

    rotation = np.eye(3)
    rotation[:2, :2] = copy.rotation
    transform = SimilarityTransform(1.0, rotation, np.array([*copy.position_mm, 0.0]))
    return replace(
        part, name=f"{part.name}, {copy.name}", copies=(),
        body=TransformedBody(part.body, transform),
        composition_field=TransformedComposition(part.composition_field, transform))
