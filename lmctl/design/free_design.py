"""The composition of a part as a function of the numbers that are free in its part file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config import toml_file
from lmctl.config.free_numbers import FreeNumber, resolve_free_numbers
from lmctl.errors import ConfigError
from lmctl.part.load import CompositionFamily
from lmctl.part.materials import CompositionField

#: Step of the differences that give slopes of fractions, as a share of a number's range. Fractions
#: are cheap and near to polynomials: the error is far below that of the fields.
_STEP_SHARE = 1e-5

#: A number of a shell, and how far the surface may seem to move, as a share of the part.
_IN_A_SHELL = re.compile(r"\.(from_mm|to_mm)$")
_SAME_SURFACE = 0.01


class FreeDesign:
    """Fractions and their slopes for points of the design space.

    A design is (n,) float64 in [0, 1]: each free number as a share of its range.
    numbers : in the order of the part file
    """

    def __init__(self, text: str, name: str, folder: Path) -> None:
        numbers = resolve_free_numbers(toml_file.parse_tables(text, name=name)).free
        if not numbers:
            raise ConfigError(f"nothing is free in {name}",
                              hint="mark a number: k = { free = [0.2, 5], start = 1 }")
        self.numbers: tuple[FreeNumber, ...] = numbers
        self._family = CompositionFamily(text, name, folder)
        self._kept: dict[bytes, CompositionField] = {}

    @property
    def start(self) -> FloatArray:
        """The part file's own design."""
        return np.array([(n.start - n.low) / (n.high - n.low) for n in self.numbers])

    def values(self, design: FloatArray) -> dict[str, float]:
        """The numbers of a design, by name."""
        return {n.name: float(n.low + x * (n.high - n.low))
                for n, x in zip(self.numbers, design, strict=True)}

    def design_of(self, values: Mapping[str, float]) -> FloatArray:
        """The design with these numbers."""
        return np.array([(values[n.name] - n.low) / (n.high - n.low) for n in self.numbers])

    def fractions(self, design: FloatArray, points: FloatArray) -> FloatArray:
        """Volume fractions (k, n_materials) at points (k, 3) [mm]."""
        key = np.asarray(design).tobytes()
        if key not in self._kept:
            if len(self._kept) > 4:
                self._kept.clear()
            self._kept[key] = self._family.composition(self.values(design))
        return self._kept[key].fractions(points)

    def refuse_other_shapes(self, inside_mm: FloatArray, surface_mm: FloatArray) -> None:
        """Raise ConfigError where a number changes the solid, whose mesh stays as it is.

        inside_mm : places in the solid, (k, 3); surface_mm : places on its surface
        """
        extent = float(np.ptp(surface_mm, axis=0).max())
        for n, number in enumerate(self.numbers):
            if not _IN_A_SHELL.search(number.path):
                continue
            for end in (0.0, 1.0):
                design = self.start
                design[n] = end
                body = self._family.body(self.values(design))
                off = np.abs(body.distance_at(surface_mm)).max()
                if (body.distance_at(inside_mm) < 0).any() or off > _SAME_SURFACE * extent:
                    raise ConfigError(
                        f"{number.name} changes the shape of the part",
                        where=f"{number.path} = {number.low + end * (number.high - number.low):g}",
                        hint="only what lies inside may be free: shells whose union stays the same")

    def slope(self, design: FloatArray, points: FloatArray, number: int) -> FloatArray:
        """Change of the fractions (k, n_materials) with one entry of the design."""
        high, low = design.copy(), design.copy()
        high[number] = min(high[number] + _STEP_SHARE, 1.0)
        low[number] = max(low[number] - _STEP_SHARE, 0.0)
        found = [self._family.composition(self.values(x)).fractions(points) for x in (high, low)]
        return np.asarray((found[0] - found[1]) / (high[number] - low[number]))
