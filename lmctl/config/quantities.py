"""Lengths, places and units as part files state them: what is possible, and how far it may go."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

#: No machine reaches farther; it keeps grids of a hostile file from overflowing.
MAX_COORDINATE_MM = 100_000.0

#: Points of a table nearer to each other than this are one place twice.
MIN_STEP_MM = 1e-6

Positive = Annotated[float, Field(gt=0)]
ShareOfOne = Annotated[float, Field(gt=0, le=1)]
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE_MM, le=MAX_COORDINATE_MM)]
Length = Annotated[float, Field(gt=0, le=MAX_COORDINATE_MM)]
Pitch = Annotated[float, Field(ge=0.0001, le=1000)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
FileName = Annotated[str, Field(min_length=1, max_length=1000)]
Name = Annotated[str, Field(min_length=1, max_length=100)]
Units = Literal["mm", "cm", "m", "inch"]

#: Millimetres in each unit a data file may be in.
MM_PER_UNIT: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}


def _has_a_direction(value: Vector) -> Vector:
    if sum(v * v for v in value) < 1e-12:
        raise ValueError("has no length, so it points nowhere")
    return value


#: A direction of any length but none.
Direction = Annotated[Vector, AfterValidator(_has_a_direction)]


def _a_polyline(value: tuple[Vector, ...]) -> tuple[Vector, ...]:
    for index in range(1, len(value)):
        if value[index] == value[index - 1]:
            raise ValueError(f"points {index} and {index + 1} are the same")
    return value


#: Places in a row, no two neighbours the same.
AxisDirection = Annotated[
    tuple[Vector, ...], Field(min_length=2, max_length=10_000), AfterValidator(_a_polyline)
]
