"""One line to deposit along, while a layer's geometry is being made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.polyline import densified_polyline


@dataclass(frozen=True)
class Toolpath:
    """points_mm : (k, 2) float64; a closed one repeats its first point last
    strip_width_mm : (k,) float64, width of the strip it fills
    """

    points_mm: FloatArray
    strip_width_mm: FloatArray
    is_closed: bool

    @property
    def length_mm(self) -> float:
        return float(self.segment_lengths_mm().sum())

    def segment_lengths_mm(self) -> FloatArray:
        """(k − 1,) length from each point to the next."""
        return np.asarray(np.linalg.norm(np.diff(self.points_mm, axis=0), axis=1))

    def strip_area_mm2(self) -> float:
        """Length times strip width: the volume it deposits over the layer height."""
        return float(
            self.segment_lengths_mm() @ (self.strip_width_mm[1:] + self.strip_width_mm[:-1]) / 2)

    def densified(self, spacing_mm: float) -> Toolpath:
        """The same with points at most `spacing_mm` apart."""
        table = densified_polyline(
            np.column_stack([self.points_mm, self.strip_width_mm]), spacing_mm)
        return Toolpath(table[:, :2], table[:, 2], self.is_closed)

    def reversed(self) -> Toolpath:
        return Toolpath(self.points_mm[::-1], self.strip_width_mm[::-1], self.is_closed)
