"""Pieces of a part tracked through successive layers: built, lost, or overhanging."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lmctl.plan.geometry import LostFeature


@dataclass
class LostPiece:
    """A lost feature through all layers it is lost in; heights in the part's coordinates [mm].

    body_name : of the body it is a piece of; None where that is not said
    """

    feature: LostFeature
    first_layer: int
    last_layer: int
    lowest_z_mm: float
    highest_z_mm: float
    volume_mm3: float
    body_name: str | None = None

    @property
    def middle_mm(self) -> tuple[float, float, float]:
        """Where it is, in the part's coordinates."""
        return (*self.feature.at_mm, (self.lowest_z_mm + self.highest_z_mm) / 2)

    def location_text(self) -> str:
        x, y = (v + 0.0 for v in np.round(self.feature.at_mm, 1))  # no −0.0
        length, width = self.feature.size_mm
        of = "" if self.body_name is None else f" of body {self.body_name!r}"
        return (f"{self.feature.kind} of {length:.3g} × {width:.2g} mm{of} "
                f"at x {x:.1f}, y {y:.1f}, z {_span(self.lowest_z_mm, self.highest_z_mm)} mm "
                f"({self.volume_mm3:.3g} mm³): {self.feature.reason}")

    def as_dict(self) -> dict[str, Any]:
        return {
            "kind": self.feature.kind, "body": self.body_name,
            "at_mm": [round(v, 3) for v in self.feature.at_mm],
            "from_z_mm": round(self.lowest_z_mm, 3), "to_z_mm": round(self.highest_z_mm, 3),
            "from_layer": self.first_layer, "to_layer": self.last_layer,
            "size_mm": [round(v, 3) for v in self.feature.size_mm],
            "volume_mm3": round(self.volume_mm3, 4),
            "why": self.feature.reason, "remedy": self.feature.remedy,
        }


@dataclass
class Overhang:
    """An overhang through the layers it goes on over; heights in the part's coordinates [mm]."""

    at_mm: tuple[float, float]
    first_layer: int
    last_layer: int
    lowest_z_mm: float
    highest_z_mm: float
    area_mm2: float
    angle_deg: float
    is_in_air: bool

    def location_text(self) -> str:
        x, y = (v + 0.0 for v in np.round(self.at_mm, 1))  # no −0.0
        angle_text = "nothing below it" if self.is_in_air else f"up to {self.angle_deg:.0f}°"
        return (
            f"at x {x:.1f}, y {y:.1f}, z {_span(self.lowest_z_mm, self.highest_z_mm)} mm: "
            f"{angle_text}, {self.area_mm2:.3g} mm²")

    def as_dict(self) -> dict[str, Any]:
        return {
            "at_mm": [round(v, 3) for v in self.at_mm],
            "from_z_mm": round(self.lowest_z_mm, 3), "to_z_mm": round(self.highest_z_mm, 3),
            "from_layer": self.first_layer, "to_layer": self.last_layer,
            "area_mm2": round(self.area_mm2, 4), "angle_deg": round(self.angle_deg, 1),
            "in_air": self.is_in_air,
        }


@dataclass
class BuiltFeature:
    """A piece of the part that is connected in each of its layers; heights in the part's
    coordinates [mm]."""

    at_mm: tuple[float, float]
    first_layer: int
    last_layer: int
    lowest_z_mm: float
    highest_z_mm: float
    volume_mm3: float = 0.0
    inside_mm3: float = 0.0

    @property
    def built_fraction(self) -> float:
        return self.inside_mm3 / self.volume_mm3 if self.volume_mm3 > 0 else 0.0

    def as_dict(self) -> dict[str, Any]:
        return {
            "at_mm": [round(v, 3) for v in self.at_mm],
            "from_z_mm": round(self.lowest_z_mm, 3), "to_z_mm": round(self.highest_z_mm, 3),
            "from_layer": self.first_layer, "to_layer": self.last_layer,
            "volume_mm3": round(self.volume_mm3, 4),
            "built_fraction": round(self.built_fraction, 5),
        }


def _span(low_mm: float, high_mm: float) -> str:
    return f"{low_mm:.2f} to {high_mm:.2f}"
