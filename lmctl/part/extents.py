"""Where the bodies of a part file lie before any of them is built, and those that are formulas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config import bodies as config
from lmctl.config.part_file import PartFile
from lmctl.errors import InputError
from lmctl.part import bodies  # each body's module is loaded where one is built

if TYPE_CHECKING:
    from lmctl.part.bodies import Body, Bounds, SimilarityTransform
    from lmctl.part.booleans import Operation
    from lmctl.part.part_data import PartData


class BodyExtents:
    """The boxes that the bodies of a checked part file lie in; perhaps a little large or infinite.

    data : what their files hold; numbers : of the bodies that have names
    """

    def __init__(self, part: PartFile, data: PartData, numbers: dict[str, int]) -> None:
        self._part = part
        self._data = data
        self._number = numbers
        self._boxes: dict[int, Bounds] = {}

    def combined_box(self, operation: Operation | None, numbers: Sequence[int]) -> Bounds:
        """The box that bodies combined so lie in."""
        boxes = [self.enclosing_box(number) for number in numbers]
        lows, highs = [box[0] for box in boxes], [box[1] for box in boxes]
        if operation == "intersection":
            low, high = np.max(lows, axis=0), np.min(highs, axis=0)
            if (low >= high).any():
                raise InputError("the intersection of the bodies leaves nothing",
                                 where=f"of {self.display_names(numbers)}",
                                 hint="check where the bodies lie")
            return low, high
        if operation == "union":
            return np.min(lows, axis=0), np.max(highs, axis=0)
        return boxes[0]

    def enclosing_box(self, number: int) -> Bounds:
        """The box a body lies in, without building it; perhaps a little large, perhaps infinite."""
        if number not in self._boxes:
            self._boxes[number] = self._measured(number)
        return self._boxes[number]

    def _measured(self, number: int) -> Bounds:
        body = self._part.body[number]
        match body:
            case config.MeshBody() | config.CloudBody():
                points = self._data.points(body)
                return points.min(axis=0), points.max(axis=0)
            case config.ShellBody():
                low, high = self.enclosing_box(self._number[body.of])
                if (high - low).min() <= 2 * body.from_mm:
                    raise InputError(
                        f"nothing of {body.of!r} lies deeper than {body.from_mm:g} mm",
                        where=f"it is {float((high - low).min()):.4g} mm thick at most",
                        hint="lower from_mm of the shell",
                    )
                return low + body.from_mm, high - body.from_mm
            case config.MovedBody():
                low, high = self.enclosing_box(self._number[body.of])
                return _moved(low, high, transform_of(body))
            case config.BooleanBody():
                return self.combined_box(body.kind, [self._number[name] for name in body.of])
            case _:
                return analytic_body(body, self.display_names([number])).tight_bounds_mm

    def display_names(self, numbers: Sequence[int]) -> str:
        """Bodies as shown to the user: by name, else by their number in the file."""
        named = [self._part.body[n].name for n in numbers]
        return ", ".join(
            repr(name) if name else f"body[{n + 1}]" for n, name in zip(numbers, named, strict=True)
        )


def analytic_body(body: config.Body, name: str) -> Body:
    """A body that needs no data and no other. name : of the body, for messages"""
    match body:
        case config.BoxBody():
            return bodies.Box(body.low_mm, body.high_mm)
        case config.SphereBody():
            return bodies.Sphere(body.centre_mm, body.radius_mm)
        case config.CylinderBody():
            return bodies.Cylinder(body.base_mm, body.top_mm, body.radius_mm)
        case config.ConeBody():
            return bodies.Cone(body.base_mm, body.top_mm, body.base_radius_mm, body.top_radius_mm)
        case config.TorusBody():
            return bodies.Torus(body.centre_mm, body.axis, body.radius_mm, body.tube_radius_mm)
        case config.HalfSpaceBody():
            return bodies.HalfSpace(body.point_mm, body.outward)
        case config.PrismBody():
            corners = np.array(body.outline_mm, dtype=np.float64)
            loop = bodies.close_polygon(corners, name)
            return bodies.Prism(loop, body.low_mm, body.high_mm)
    raise TypeError(body.kind)


def transform_of(body: config.MovedBody) -> SimilarityTransform:
    """The motion that a moved body states."""
    turn = body.turn or config.Rotation(axis=(0.0, 0.0, 1.0), degrees=0.0)
    return bodies.similarity_transform(
        body.scale, turn.axis, turn.degrees, turn.through_mm, body.by_mm)


def _moved(low: FloatArray, high: FloatArray, by: SimilarityTransform) -> Bounds:
    if not np.isfinite([low, high]).all():
        return np.full(3, -np.inf), np.full(3, np.inf)
    return bodies.TransformedBody(bodies.Box(tuple(low), tuple(high)), by).tight_bounds_mm
