"""The part file: bodies, materials, process, as written in TOML; data only, no geometry.

`lmctl.part` turns it into something that answers; `lmctl.plan` reads `process` and `placement`.
Lengths in it are millimetres; only data files have units of their own. `part_rules` checks what
concerns several keys at once, so that one reading names every mistake.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from lmctl.config.toml_file import Model

#: No machine reaches farther; it keeps grids of a hostile file from overflowing.
FARTHEST_MM = 100_000.0

#: Points of a table nearer to each other than this are one place twice.
LEAST_STEP_MM = 1e-6

Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(gt=0, le=1)]
Coordinate = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]
Length = Annotated[float, Field(gt=0, le=FARTHEST_MM)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Units = Literal["mm", "cm", "m", "inch"]

#: Millimetres in each unit a data file may be in.
MM_PER_UNIT: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}


class Material(Model):
    """One powder, as the process sees it (process.md 3.1).

    density_g_cm3, apparent_g_cm3 : solid and loose-powder density; None takes the library's
    catch_efficiency : share of the fed powder that ends in the bead, η in (0, 1]
    power_W, speed_mm_s : recipe of the pure material; mixtures interpolate by volume fraction
    """

    name: Annotated[str, Field(min_length=1, max_length=60)]
    density_g_cm3: Annotated[float, Field(gt=0, le=30)] | None = None
    apparent_g_cm3: Annotated[float, Field(gt=0, le=30)] | None = None
    catch_efficiency: Share | None = None
    power_W: Positive | None = None
    speed_mm_s: Positive | None = None


class Process(Model):
    """How beads are laid. Defaults are the medium DED class of process.md 3.3, and are named.

    overlap : share of the bead width by which neighbours overlap; pitch = width · (1 − overlap)
    fraction_step : quantum of volume fraction along a path (ε_c, process.md 4)
    lead_in_mm : run-up and run-out with the beam off at each end of a path
    """

    bead_width_mm: Annotated[float, Field(ge=0.05, le=100)] = 2.0
    overlap: Annotated[float, Field(ge=0, lt=0.9)] = 0.333
    layer_height_mm: Annotated[float, Field(ge=0.005, le=100)] = 0.8
    speed_mm_s: Positive = 10.0
    travel_speed_mm_s: Positive = 50.0
    power_W: Positive = 1500.0
    fraction_step: Annotated[float, Field(ge=0.001, le=0.5)] = 0.02
    lead_in_mm: Annotated[float, Field(ge=0, le=20)] = 1.0
    strategy: Literal["in-plane", "iso-3d"] = "in-plane"
    powder: Literal["lead", "dwell", "none"] = "lead"
    dwell_s: Annotated[float, Field(ge=0, le=600)] = 30.0


class MeshBody(Model):
    """A closed surface of triangles from a file. STL, PLY and OBJ state no units: say them."""

    kind: Literal["mesh"]
    file: Annotated[str, Field(min_length=1, max_length=1000)]
    units: Units


class CloudBody(Model):
    """Points measured on a surface, in no order and without normals (XYZ, CSV, PLY)."""

    kind: Literal["cloud"]
    file: Annotated[str, Field(min_length=1, max_length=1000)]
    units: Units


class BoxBody(Model):
    """The box between two opposite corners."""

    kind: Literal["box"]
    low_mm: Vector
    high_mm: Vector

    @model_validator(mode="after")
    def _not_empty(self) -> BoxBody:
        flat = [a for a, lo, hi in zip("xyz", self.low_mm, self.high_mm, strict=True) if lo >= hi]
        if flat:
            raise ValueError(f"low_mm is not below high_mm in {', '.join(flat)}")
        return self


class SphereBody(Model):
    """A ball."""

    kind: Literal["sphere"]
    centre_mm: Vector
    radius_mm: Length


class CylinderBody(Model):
    """A solid round bar from the centre of one end face to that of the other."""

    kind: Literal["cylinder"]
    base_mm: Vector
    top_mm: Vector
    radius_mm: Length

    @model_validator(mode="after")
    def _not_empty(self) -> CylinderBody:
        if self.base_mm == self.top_mm:
            raise ValueError("base_mm and top_mm are the same point")
        return self


Body = Annotated[
    MeshBody | CloudBody | BoxBody | SphereBody | CylinderBody, Field(discriminator="kind")
]


class AxisFeature(Model):
    """Distance to an infinite line."""

    kind: Literal["axis"]
    point_mm: Vector
    direction: Vector

    @field_validator("direction")
    @classmethod
    def _has_a_direction(cls, value: Vector) -> Vector:
        if sum(v * v for v in value) < 1e-12:
            raise ValueError("has no length, so it points nowhere")
        return value


class PointFeature(Model):
    """Distance to a point."""

    kind: Literal["point"]
    at_mm: Vector


class SurfaceFeature(Model):
    """Depth below the part's own surface."""

    kind: Literal["surface"]


class CoordinateFeature(Model):
    """A coordinate itself, with its sign: composition explicit in x, y or z."""

    kind: Literal["coordinate"]
    along: Literal["x", "y", "z"]


Feature = Annotated[
    AxisFeature | PointFeature | SurfaceFeature | CoordinateFeature, Field(discriminator="kind")
]

Fraction = Annotated[float, Field(ge=0, le=1)]
#: Volume fractions by material name; materials left out are 0; they must sum to 1.
Mixture = Annotated[dict[str, Fraction], Field(min_length=1)]


class _Span(Model):
    """A profile between two mixtures: `near` at over_mm[0] of the feature, `far` at over_mm[1].

    over_mm : may be left out for the own surface only: then it is [0, largest depth], as in (5)
    """

    near: Mixture
    far: Mixture
    over_mm: tuple[Coordinate, Coordinate] | None = None

    @field_validator("over_mm")
    @classmethod
    def _ordered(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"the first value must be below the second, not {list(value)}")
        return value


class LinearProfile(_Span):
    """far · d + near · (1 − d), d running from 0 to 1 over `over_mm`."""

    kind: Literal["linear"]


class PowerProfile(_Span):
    """far · f + near · (1 − f) with f = (a·d)^k clamped to [0, 1] (method.md (4))."""

    kind: Literal["power"]
    a: Annotated[float, Field(gt=0, le=1000)] = 1.0
    k: Annotated[float, Field(gt=0, le=100)]


class TablePoint(Model):
    """The mixture at one distance from the feature."""

    at_mm: Coordinate
    of: Mixture


class TableProfile(Model):
    """Mixtures at rising distances, linear between them, constant beyond the first and last."""

    kind: Literal["table"]
    points: Annotated[tuple[TablePoint, ...], Field(min_length=1, max_length=10_000)]

    @field_validator("points")
    @classmethod
    def _rising(cls, value: tuple[TablePoint, ...]) -> tuple[TablePoint, ...]:
        for index in range(1, len(value)):
            if value[index].at_mm < value[index - 1].at_mm + LEAST_STEP_MM:
                raise ValueError(
                    f"point {index + 1} at {value[index].at_mm:g} mm does not lie beyond "
                    f"point {index} at {value[index - 1].at_mm:g} mm"
                )
        return value


class ConstantProfile(Model):
    """One mixture everywhere."""

    kind: Literal["constant"]
    of: Mixture


Profile = Annotated[
    LinearProfile | PowerProfile | TableProfile | ConstantProfile, Field(discriminator="kind")
]


class Composition(Model):
    """Of what the part is: distance to a feature, and the mixture at each distance."""

    feature: Feature = SurfaceFeature(kind="surface")
    profile: Profile


class Placement(Model):
    """Where the part file's origin lies in program coordinates."""

    origin_mm: Vector


class PartFile(Model):
    """A whole part file; read one with `part_rules.load_part_file`, which checks all of it.

    pitch_mm : of the grid that fields are stored on; None chooses it from the bead width
    combine : how several bodies make one solid; a difference takes all others from the first
    placement : None centres the part on the platform, its lowest point at z = 0
    """

    name: Annotated[str, Field(min_length=1, max_length=100)]
    pitch_mm: Annotated[float, Field(ge=0.0001, le=1000)] | None = None
    combine: Literal["union", "difference", "intersection"] | None = None
    material: Annotated[tuple[Material, ...], Field(min_length=1, max_length=64)]
    body: Annotated[tuple[Body, ...], Field(min_length=1, max_length=1000)]
    composition: Composition | None = None
    placement: Placement | None = None
    process: Process = Process()
