"""The composition of a part or body, as a part file states it: features, profiles, blends."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from lmctl.config.quantities import (
    MIN_STEP_MM,
    AxisDirection,
    Coordinate,
    Direction,
    FileName,
    Name,
    Units,
    Vector,
)
from lmctl.config.toml_file import ConfigModel


class PointFeature(ConfigModel):
    """Distance to a point.

    kind : "point"
    at_mm : the point
    """

    kind: Literal["point"]
    at_mm: Vector


class SegmentFeature(ConfigModel):
    """Distance to a straight line between two points.

    kind : "segment"
    start_mm, end_mm : the points
    """

    kind: Literal["segment"]
    start_mm: Vector
    end_mm: Vector

    @model_validator(mode="after")
    def _not_empty(self) -> SegmentFeature:
        if self.start_mm == self.end_mm:
            raise ValueError("start_mm and end_mm are the same point")
        return self


class AxisFeature(ConfigModel):
    """Distance to an infinite line.

    kind : "axis"
    point_mm : a point of the line
    direction : of the line, of any length
    """

    kind: Literal["axis"]
    point_mm: Vector
    direction: Direction


class PolylineFeature(ConfigModel):
    """Distance to the straight lines through points, in their order; open at its ends.

    kind : "polyline"
    points_mm : the points
    """

    kind: Literal["polyline"]
    points_mm: AxisDirection


class SplineFeature(ConfigModel):
    """Distance to the smooth curve through points, in their order (a natural cubic spline).

    kind : "spline"
    points_mm : the points
    """

    kind: Literal["spline"]
    points_mm: Annotated[AxisDirection, Field(max_length=1000)]


class PlaneFeature(ConfigModel):
    """Distance to a plane, on either side of it.

    kind : "plane"
    point_mm : a point of the plane
    normal : perpendicular to the plane, of any length
    """

    kind: Literal["plane"]
    point_mm: Vector
    normal: Direction


class FaceFeature(ConfigModel):
    """Distance to one face of a mesh body: the patch around a place, or a named group of an OBJ.

    of : the mesh body's name
    at_mm : a place on the face; the patch reaches as far as edges are blunter than angle_deg
    group : the name of a `g` or `o` group in an OBJ file
    kind : "face"
    angle_deg : the least bend of an edge that ends the patch
    """

    kind: Literal["face"]
    of: Name
    at_mm: Vector | None = None
    angle_deg: Annotated[float, Field(gt=0, le=180)] = 30.0
    group: Name | None = None

    @model_validator(mode="after")
    def _one_face_choice(self) -> FaceFeature:
        if (self.at_mm is None) == (self.group is None):
            raise ValueError("say which face: either at_mm, a place on it, or group, its name")
        return self


class SheetFeature(ConfigModel):
    """Distance to any surface of triangles from a file, open or closed.

    kind : "sheet"
    file : of triangles, beside the part file
    units : of its coordinates
    """

    kind: Literal["sheet"]
    file: FileName
    units: Units


class SurfaceFeature(ConfigModel):
    """Depth below a body's surface, or below an iso-contour of its distance.

    of : a body's name; None is the body (or the part) this composition belongs to
    level_mm : depth of the iso-contour that depth is counted from
    kind : "surface"
    """

    kind: Literal["surface"]
    of: Name | None = None
    level_mm: Coordinate = 0.0


class CoordinateFeature(ConfigModel):
    """A coordinate itself, with its sign: composition explicit in x, y or z.

    kind : "coordinate"
    along : the axis
    """

    kind: Literal["coordinate"]
    along: Literal["x", "y", "z"]


Feature = Annotated[
    PointFeature | SegmentFeature | AxisFeature | PolylineFeature | SplineFeature | PlaneFeature
    | FaceFeature | SheetFeature | SurfaceFeature | CoordinateFeature,
    Field(discriminator="kind"),
]

Fraction = Annotated[float, Field(ge=0, le=1)]
#: Volume fractions by material name; materials left out are 0; they must sum to 1.
Mixture = Annotated[dict[str, Fraction], Field(min_length=1)]
Range = tuple[Coordinate, Coordinate]


def _ordered(value: Range) -> Range:
    if value[0] >= value[1]:
        raise ValueError(f"the first value must be below the second, not {list(value)}")
    return value


class _Span(ConfigModel):
    """A profile between two mixtures: `near` at over_mm[0] of the feature, `far` at over_mm[1].

    over_mm : may be left out for a surface only: then it is [0, largest depth], as in (5)
    near, far : volume fractions by material; materials left out are 0, and the sum is 1
    """

    near: Mixture
    far: Mixture
    over_mm: Range | None = None

    @field_validator("over_mm")
    @classmethod
    def _rising(cls, value: Range | None) -> Range | None:
        return None if value is None else _ordered(value)


class LinearProfile(_Span):
    """far · d + near · (1 − d), d running from 0 to 1 over `over_mm`.

    kind : "linear"
    """

    kind: Literal["linear"]


class ParabolaProfile(_Span):
    """far · d² + near · (1 − d²), d running from 0 to 1 over `over_mm`.

    Source: docs/explanation/multi-colour-distance-field.md, The paper's examples.

    kind : "parabola"
    """

    kind: Literal["parabola"]


class NormalisedProfile(ConfigModel):
    """far · d + near · (1 − d) with d the share of the largest depth (Zhou et al. 2009, Eq. 5).

    kind : "normalised"
    near, far : volume fractions by material at the feature and at the largest depth
    """

    kind: Literal["normalised"]
    near: Mixture
    far: Mixture


class PowerProfile(_Span):
    """far · f + near · (1 − f) with f = (a·d)^k clamped to [0, 1] (Zhou et al. 2009, Eq. (4)).

    kind : "power"
    a, k : scale and exponent
    """

    kind: Literal["power"]
    a: Annotated[float, Field(gt=0, le=1000)] = 1.0
    k: Annotated[float, Field(gt=0, le=100)]


class TablePoint(ConfigModel):
    """The mixture at one distance from the feature.

    at_mm : the distance
    of : volume fractions by material
    """

    at_mm: Coordinate
    of: Mixture


class TableProfile(ConfigModel):
    """Mixtures at rising distances, linear between them, constant beyond the first and last.

    kind : "table"
    points : the distances with their mixtures
    """

    kind: Literal["table"]
    points: Annotated[tuple[TablePoint, ...], Field(min_length=1, max_length=10_000)]

    @field_validator("points")
    @classmethod
    def _rising(cls, value: tuple[TablePoint, ...]) -> tuple[TablePoint, ...]:
        for index in range(1, len(value)):
            if value[index].at_mm < value[index - 1].at_mm + MIN_STEP_MM:
                raise ValueError(
                    f"point {index + 1} at {value[index].at_mm:g} mm does not lie beyond "
                    f"point {index} at {value[index - 1].at_mm:g} mm"
                )
        return value


class MixtureStep(ConfigModel):
    """One mixture over a range of distances.

    over_mm : from where to where
    of : volume fractions by material
    """

    over_mm: Range
    of: Mixture

    @field_validator("over_mm")
    @classmethod
    def _rising(cls, value: Range) -> Range:
        return _ordered(value)


class StepsProfile(ConfigModel):
    """Layers of one mixture each, one beginning where the other ends; the outer two go on.

    kind : "steps"
    steps : the ranges with their mixtures
    """

    kind: Literal["steps"]
    steps: Annotated[tuple[MixtureStep, ...], Field(min_length=1, max_length=10_000)]

    @field_validator("steps")
    @classmethod
    def _joined(cls, value: tuple[MixtureStep, ...]) -> tuple[MixtureStep, ...]:
        for index in range(1, len(value)):
            end, start = value[index - 1].over_mm[1], value[index].over_mm[0]
            if abs(end - start) > MIN_STEP_MM:
                fault = "leaves a gap after" if start > end else "overlaps"
                raise ValueError(
                    f"step {index + 1} {fault} step {index}: it begins at {start:g} mm, "
                    f"step {index} ends at {end:g} mm"
                )
        return value


class ConstantProfile(ConfigModel):
    """One mixture everywhere.

    kind : "constant"
    of : volume fractions by material
    """

    kind: Literal["constant"]
    of: Mixture


Profile = Annotated[
    LinearProfile | ParabolaProfile | NormalisedProfile | PowerProfile | TableProfile
    | StepsProfile | ConstantProfile,
    Field(discriminator="kind"),
]


class BlendPart(ConfigModel):
    """One feature and profile of a blend.

    feature, profile : as of a composition
    weight : its constant share; None with inverse-distance weights
    """

    feature: Feature = SurfaceFeature(kind="surface")
    profile: Profile
    weight: Annotated[float, Field(ge=0, le=1)] | None = None


class SampledMixture(ConfigModel):
    """Mixture on the voxels of a 3MF file (Volumetric Extension), as another program designed it.

    file : the 3MF file; its coordinates, in millimetres, are those of the body
    properties : name of the property that holds a material's volume fraction, by material; left
        out, it is `volume fraction of MATERIAL`, as `lmctl export PART --to 3mf` writes it
    """

    file: FileName
    properties: dict[str, Name] = Field(default_factory=dict)

    def property_of(self, material: str) -> str:
        """Name in the file of a material's volume fraction."""
        return self.properties.get(material, f"volume fraction of {material}")


class Composition(ConfigModel):
    """Material of a part or body: a mixture at each distance to a feature, a blend of several, or
    sampled in a file.

    blend, weights : (6)-(8): Σ wᵢ f(rᵢ) with constant weights that sum to 1, or with weights
        by inverse distance to the power `power`
    feature : what distance is measured to
    profile : the mixture at each distance; None where there is a blend
    power : of the distance, for weights by inverse distance
    sampled : mixtures at the voxels of a file; None where the mixture follows a feature
    """

    feature: Feature = SurfaceFeature(kind="surface")
    profile: Profile | None = None
    blend: Annotated[tuple[BlendPart, ...], Field(max_length=100)] = ()
    weights: Literal["constant", "inverse-distance"] = "constant"
    power: Annotated[float, Field(gt=0, le=20)] = 1.0
    sampled: SampledMixture | None = None


def features_of(composition: Composition) -> list[Feature]:
    """Everything a composition measures to."""
    return [composition.feature, *(part.feature for part in composition.blend)]


def measured_bodies(composition: Composition) -> set[str]:
    """Names of the bodies whose surfaces or faces a composition's features are."""
    return {
        f.of for f in features_of(composition)
        if isinstance(f, FaceFeature | SurfaceFeature) and f.of
    }
