"""The bodies of a part as a part file states them: data files, formulas, combinations of bodies.

A body that other bodies use has a name, and they refer to it by that name. Bodies that no other
body names make up the part.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from lmctl.config.composition import Composition
from lmctl.config.quantities import (
    Coordinate,
    Direction,
    FileName,
    Length,
    Name,
    Pitch,
    Units,
    Vector,
)
from lmctl.config.toml_file import ConfigModel

#: Deepest nesting of bodies: deeper than any real part, shallow enough to walk.
MAX_TREE_DEPTH = 50

#: Bodies of a tree, each counted as often as it is named: a few lines can ask for 2^50 of them.
MAX_BODIES = 5000


class _Body(ConfigModel):
    """What all bodies share.

    name : by which others refer to it
    composition : its materials; None where the part states them, or where the body only cuts
    allowance_mm : how far its outline in every layer is moved outwards, for machining; negative:
        inwards, as for what is cut away with material left on its walls
    """

    name: Name | None = None
    composition: Composition | None = None
    allowance_mm: Annotated[float, Field(ge=-20, le=20)] = 0.0


class MeshBody(_Body):
    """A closed surface of triangles from a file. STL, PLY, OBJ and OFF need `units`.

    units : may be left out for 3MF files only, which state theirs (part_rules)
    group : of an OBJ file, the `g` or `o` group that is this body; None takes all of the file
    pitch_mm : of the grid its distance is stored on; None takes the part's
    kind : "mesh"
    file : of triangles, beside the part file
    """

    kind: Literal["mesh"]
    file: FileName
    units: Units | None = None
    group: Name | None = None
    pitch_mm: Pitch | None = None


class CloudBody(_Body):
    """Points measured on a surface, in no order, with or without normals (XYZ, CSV, PLY).

    kind : "cloud"
    file : of points, beside the part file
    units : of its coordinates
    pitch_mm : of the grid its distance is stored on; None takes the part's
    """

    kind: Literal["cloud"]
    file: FileName
    units: Units
    pitch_mm: Pitch | None = None


class BoxBody(_Body):
    """The box between two opposite corners.

    kind : "box"
    low_mm, high_mm : the corner with the least and the one with the greatest coordinates
    """

    kind: Literal["box"]
    low_mm: Vector
    high_mm: Vector

    @model_validator(mode="after")
    def _not_empty(self) -> BoxBody:
        flat = [a for a, lo, hi in zip("xyz", self.low_mm, self.high_mm, strict=True) if lo >= hi]
        if flat:
            raise ValueError(f"low_mm is not below high_mm in {', '.join(flat)}")
        return self


class SphereBody(_Body):
    """A ball.

    kind : "sphere"
    centre_mm, radius_mm : of the ball
    """

    kind: Literal["sphere"]
    centre_mm: Vector
    radius_mm: Length


class _Along(_Body):
    """A body along a line between the centres of its two end faces.

    base_mm, top_mm : the centres
    """

    base_mm: Vector
    top_mm: Vector

    @model_validator(mode="after")
    def _not_empty(self) -> _Along:
        if self.base_mm == self.top_mm:
            raise ValueError("base_mm and top_mm are the same point")
        return self


class CylinderBody(_Along):
    """A solid round bar.

    kind : "cylinder"
    radius_mm : of its section
    """

    kind: Literal["cylinder"]
    radius_mm: Length


class ConeBody(_Along):
    """A bar that tapers; with one radius 0 it is pointed.

    kind : "cone"
    base_radius_mm, top_radius_mm : at its two ends
    """

    kind: Literal["cone"]
    base_radius_mm: Annotated[float, Field(ge=0, le=100_000)]
    top_radius_mm: Annotated[float, Field(ge=0, le=100_000)]

    @model_validator(mode="after")
    def _not_a_line(self) -> ConeBody:
        if self.base_radius_mm == self.top_radius_mm == 0:
            raise ValueError("base_radius_mm and top_radius_mm are both 0")
        return self


class TorusBody(_Body):
    """A ring of round section around an axis.

    kind : "torus"
    centre_mm, axis : of the ring
    radius_mm : of the circle its tube runs along
    tube_radius_mm : of its section
    """

    kind: Literal["torus"]
    centre_mm: Vector
    axis: Direction = (0.0, 0.0, 1.0)
    radius_mm: Length
    tube_radius_mm: Length

    @model_validator(mode="after")
    def _has_a_hole(self) -> TorusBody:
        if self.tube_radius_mm >= self.radius_mm:
            raise ValueError("tube_radius_mm must be below radius_mm, else the ring has no hole")
        return self


class HalfSpaceBody(_Body):
    """Everything on one side of a plane: to cut with.

    kind : "half-space"
    point_mm : a point of the plane
    outward : the direction out of the body
    """

    kind: Literal["half-space"]
    point_mm: Vector
    outward: Direction


class PrismBody(_Body):
    """A polygon in the xy plane, made solid from low_mm to high_mm along z.

    outline_mm : its corners in order, either way round, the first not repeated; it must not cross
        itself
    kind : "prism"
    low_mm, high_mm : where it begins and ends along z
    """

    kind: Literal["prism"]
    outline_mm: Annotated[
        tuple[tuple[Coordinate, Coordinate], ...], Field(min_length=3, max_length=10_000)
    ]
    low_mm: Coordinate
    high_mm: Coordinate

    @model_validator(mode="after")
    def _not_flat(self) -> PrismBody:
        if self.low_mm >= self.high_mm:
            raise ValueError("low_mm is not below high_mm")
        return self


class ShellBody(_Body):
    """The part of a body between two depths: 0 is its surface, negative ones lie outside it.

    to_mm : None is everything deeper than from_mm
    kind : "shell"
    of : the body's name
    from_mm : the lesser depth
    """

    kind: Literal["shell"]
    of: Name
    from_mm: Coordinate = 0.0
    to_mm: Coordinate | None = None

    @model_validator(mode="after")
    def _not_empty(self) -> ShellBody:
        if self.to_mm is not None and self.from_mm >= self.to_mm:
            raise ValueError("from_mm is not below to_mm")
        return self


class Rotation(ConfigModel):
    """A turn about an axis through a point, counter-clockwise seen against its direction.

    axis : its direction
    degrees : the angle
    through_mm : a point of the axis
    """

    axis: Direction
    degrees: Annotated[float, Field(ge=-36_000, le=36_000)]
    through_mm: Vector = (0.0, 0.0, 0.0)


class MovedBody(_Body):
    """A body scaled about the origin, then turned, then moved; its composition goes with it.

    kind : "moved"
    of : the body's name
    scale : by which lengths grow
    turn : the rotation; None for none
    by_mm : the translation
    """

    kind: Literal["moved"]
    of: Name
    scale: Annotated[float, Field(ge=1e-3, le=1e3)] = 1.0
    turn: Rotation | None = None
    by_mm: Vector = (0.0, 0.0, 0.0)


class BooleanBody(_Body):
    """Several bodies as one; a difference takes all others from the first.

    kind : what is made of them
    of : the bodies' names
    """

    kind: Literal["union", "difference", "intersection"]
    of: Annotated[tuple[Name, ...], Field(min_length=2, max_length=1000)]


Body = Annotated[
    MeshBody | CloudBody | BoxBody | SphereBody | CylinderBody | ConeBody | TorusBody
    | HalfSpaceBody | PrismBody | ShellBody | MovedBody | BooleanBody,
    Field(discriminator="kind"),
]


def referenced_bodies(body: Body) -> tuple[str, ...]:
    """The names of the bodies this one is made of."""
    if isinstance(body, ShellBody | MovedBody):
        return (body.of,)
    return body.of if isinstance(body, BooleanBody) else ()
