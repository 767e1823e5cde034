"""Build composition fields from the compositions that a part file states."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config import composition as config
from lmctl.errors import InputError
from lmctl.part.bodies.body import Body
from lmctl.part.materials.composition import BlendedComposition, CompositionField, GradedComposition
from lmctl.part.materials.features import (
    AxisDistance,
    CoordinateValue,
    DepthBelowSurface,
    Feature,
    PlaneDistance,
    PointDistance,
    PolylineDistance,
    SegmentDistance,
    TriangleSheetDistance,
    spline_polyline,
)
from lmctl.part.materials.profiles import (
    MixtureProfile,
    PowerLawProfile,
    SteppedProfile,
    TabulatedProfile,
)

if TYPE_CHECKING:
    from lmctl.part.sources.volumetric_3mf import VoxelProperty


@dataclass(frozen=True)
class CompositionContext:
    """What a composition may refer to.

    material_names : of the part's materials, in order
    body_named : a body by its name
    triangles_of : those a face or sheet feature names, (m, 3, 3) float64 [mm]
    voxels_of : what a file holds of the named properties
    """

    material_names: tuple[str, ...]
    body_named: Callable[[str], Body]
    triangles_of: Callable[[config.FaceFeature | config.SheetFeature], FloatArray]
    voxels_of: Callable[[config.SampledMixture], Sequence[VoxelProperty]]


def composition_field_of(composition: config.Composition, body: Body,
                         around: CompositionContext) -> CompositionField:
    """The rule a checked composition states for a body."""
    if composition.sampled is not None:
        from lmctl.part.materials.sampled import sampled_composition  # late: few parts have one

        return sampled_composition(
            around.voxels_of(composition.sampled), body, composition.sampled.file)
    if not composition.blend:
        assert composition.profile is not None, "part_rules asks for it"
        return _graded(composition.feature, composition.profile, body, around)
    parts = tuple(_graded(p.feature, p.profile, body, around) for p in composition.blend)
    if composition.weights == "inverse-distance":
        return BlendedComposition(parts, None, composition.power)
    return BlendedComposition(parts, tuple(p.weight or 0.0 for p in composition.blend))


def _graded(
    feature: config.Feature, profile: config.Profile, body: Body, around: CompositionContext
) -> GradedComposition:
    measured = feature_of(feature, body, around)
    return GradedComposition(measured, _profile(profile, measured, around.material_names))


def feature_of(feature: config.Feature, body: Body, around: CompositionContext) -> Feature:
    """A feature made measurable; body : whose surface is meant where none is named."""
    match feature:
        case config.PointFeature():
            return PointDistance(feature.at_mm)
        case config.SegmentFeature():
            return SegmentDistance(feature.start_mm, feature.end_mm)
        case config.AxisFeature():
            return AxisDistance(feature.point_mm, feature.direction)
        case config.PolylineFeature():
            return PolylineDistance(np.array(feature.points_mm, dtype=np.float64))
        case config.SplineFeature():
            return spline_polyline(np.array(feature.points_mm, dtype=np.float64))
        case config.PlaneFeature():
            return PlaneDistance(feature.point_mm, feature.normal)
        case config.FaceFeature() | config.SheetFeature():
            return TriangleSheetDistance(around.triangles_of(feature))
        case config.SurfaceFeature():
            of = body if feature.of is None else around.body_named(feature.of)
            return DepthBelowSurface(of, feature.level_mm)
        case config.CoordinateFeature():
            return CoordinateValue("xyz".index(feature.along))


def _profile(profile: config.Profile, feature: Feature, names: tuple[str, ...]) -> MixtureProfile:
    match profile:
        case config.TableProfile():
            return TabulatedProfile(
                np.array([point.at_mm for point in profile.points]),
                np.stack([_vector(point.of, names) for point in profile.points]),
            )
        case config.StepsProfile():
            return SteppedProfile(
                np.array([step.over_mm[1] for step in profile.steps[:-1]]),
                np.stack([_vector(step.of, names) for step in profile.steps]),
            )
        case config.ConstantProfile():
            return TabulatedProfile(np.zeros(1), _vector(profile.of, names)[None])
    near, far = _vector(profile.near, names), _vector(profile.far, names)
    match profile:
        case config.NormalisedProfile():
            return PowerLawProfile(near, far, _deepest(feature))
        case config.PowerProfile():
            return PowerLawProfile(near, far, profile.over_mm or _deepest(feature), profile.a,
                                   profile.k)
        case config.ParabolaProfile():
            return PowerLawProfile(near, far, profile.over_mm or _deepest(feature), k=2.0)
        case config.LinearProfile():
            return PowerLawProfile(near, far, profile.over_mm or _deepest(feature))


def _deepest(feature: Feature) -> tuple[float, float]:
    """(5): from the surface to the largest depth, refined between the nodes.

    Raises InputError where there is nothing deeper than the feature's level, or no end of it.
    """
    assert isinstance(feature, DepthBelowSurface), "part_rules asks for over_mm with all others"
    largest = feature.body.maximum_depth_mm
    if not feature.level_mm < largest < math.inf:
        raise InputError(
            f"a profile over the depth below {feature.level_mm:g} mm has no length",
            where="the body it is measured from has no deepest place" if largest == math.inf else
            f"the deepest place of the body it is measured from is at {largest:.4g} mm",
            hint="give the profile over_mm" + (
                "" if largest == math.inf else ", or lower the feature's level_mm"),
        )
    return 0.0, largest - feature.level_mm


def _vector(mixture: dict[str, float], names: tuple[str, ...]) -> FloatArray:
    return np.array([mixture.get(name, 0.0) for name in names])
