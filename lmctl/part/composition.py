"""Of what a part is: distance to a feature, and the mixture at each distance (method.md 2).

Fractions are volume fractions in the order of the part's materials; every mixture that a rule
gives is non-negative and sums to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.config import part_file as config
from lmctl.field.features import axis_distance, point_distance
from lmctl.part.bodies import Body

FloatArray = NDArray[np.float64]


class Feature(Protocol):
    """Something distance is measured to."""

    def distance(self, points: FloatArray) -> FloatArray:
        """points (n, 3) [mm] -> (n,) float64 [mm]"""


class Profile(Protocol):
    """The mixture at each distance."""

    def fractions(self, distance: FloatArray) -> FloatArray:
        """distance (n,) [mm] -> (n, n_materials) float64, each ≥ 0, rows summing to 1"""


@dataclass(frozen=True)
class Axis:
    """Distance to an infinite line; direction of any length but 0."""

    point_mm: tuple[float, float, float]
    direction: tuple[float, float, float]

    def distance(self, points: FloatArray) -> FloatArray:
        return axis_distance(points, self.point_mm, self.direction)


@dataclass(frozen=True)
class Point:
    """Distance to a point."""

    at_mm: tuple[float, float, float]

    def distance(self, points: FloatArray) -> FloatArray:
        return point_distance(points, self.at_mm)


@dataclass(frozen=True)
class OwnSurface:
    """Depth below the surface of a body: its signed distance (method.md (1))."""

    body: Body

    def distance(self, points: FloatArray) -> FloatArray:
        return self.body.at(points)


@dataclass(frozen=True)
class Coordinate:
    """x (0), y (1) or z (2) itself, with its sign."""

    axis: int

    def distance(self, points: FloatArray) -> FloatArray:
        return np.asarray(points[:, self.axis], dtype=np.float64)


@dataclass(frozen=True)
class Span:
    """near · (1 − f) + far · f with f = (a·d)^k clamped to [0, 1] (method.md (4); k = 1: linear).

    d runs from 0 at over_mm[0] to 1 at over_mm[1], clamped; near, far : (n_materials,)
    """

    near: FloatArray
    far: FloatArray
    over_mm: tuple[float, float]
    a: float = 1.0
    k: float = 1.0

    def fractions(self, distance: FloatArray) -> FloatArray:
        start, end = self.over_mm
        d = np.clip((distance - start) / (end - start), 0.0, 1.0)
        f = np.clip((self.a * d) ** self.k, 0.0, 1.0)[:, None]
        return _whole(self.near * (1.0 - f) + self.far * f)


@dataclass(frozen=True)
class Table:
    """Mixtures at rising distances, linear between, constant beyond; one row is a constant.

    at_mm : (k,) strictly rising; of : (k, n_materials)
    """

    at_mm: FloatArray
    of: FloatArray

    def fractions(self, distance: FloatArray) -> FloatArray:
        columns = [np.interp(distance, self.at_mm, column) for column in self.of.T]
        return _whole(np.stack(columns, axis=1))


@dataclass(frozen=True)
class Rule:
    """Composition of a body: a profile over the distance to a feature."""

    feature: Feature
    profile: Profile

    def fractions(self, points: FloatArray) -> FloatArray:
        """points (n, 3) float64 [mm] -> (n, n_materials) float64, each ≥ 0, rows summing to 1"""
        return self.profile.fractions(self.feature.distance(points))


def rule_of(part: config.PartFile, body: Body) -> Rule:
    """The rule a checked part file states; its one material everywhere where it states none."""
    names = [material.name for material in part.material]
    if part.composition is None:
        return Rule(Coordinate(2), Table(np.zeros(1), np.ones((1, 1))))
    feature = _feature(part.composition.feature, body)
    return Rule(feature, _profile(part.composition.profile, names, body))


def _feature(feature: config.Feature, body: Body) -> Feature:
    match feature:
        case config.AxisFeature():
            return Axis(feature.point_mm, feature.direction)
        case config.PointFeature():
            return Point(feature.at_mm)
        case config.SurfaceFeature():
            return OwnSurface(body)
        case config.CoordinateFeature():
            return Coordinate("xyz".index(feature.along))


def _profile(profile: config.Profile, names: list[str], body: Body) -> Profile:
    match profile:
        case config.LinearProfile() | config.PowerProfile():
            near, far = _vector(profile.near, names), _vector(profile.far, names)
            # (5): normalised by the largest depth where the part file gives no range
            over = profile.over_mm or (0.0, body.largest_depth_mm)
            if isinstance(profile, config.PowerProfile):
                return Span(near, far, over, profile.a, profile.k)
            return Span(near, far, over)
        case config.TableProfile():
            return Table(
                np.array([point.at_mm for point in profile.points]),
                np.stack([_vector(point.of, names) for point in profile.points]),
            )
        case config.ConstantProfile():
            return Table(np.zeros(1), _vector(profile.of, names)[None])


def _vector(mixture: dict[str, float], names: list[str]) -> FloatArray:
    return np.array([mixture.get(name, 0.0) for name in names])


def _whole(fractions: FloatArray) -> FloatArray:
    """Rows without the −1e-17 that interpolation leaves, made to sum to 1."""
    positive = np.maximum(fractions, 0.0)
    return np.asarray(positive / positive.sum(axis=1, keepdims=True), dtype=np.float64)
