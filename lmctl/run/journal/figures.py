"""What went into a layer or a part. Planned, reported and inferred figures have one form.

They are never mixed: the place of each `ExecutionFigures` object states which kind its numbers are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Decimals that a journal keeps: micrometres, milliseconds, 0.1 J, 0.1 mg.
_PATH_DECIMALS, _TIME_DECIMALS, _ENERGY_DECIMALS, _POWDER_DECIMALS = 3, 3, 1, 4


@dataclass(frozen=True)
class ExecutionFigures:
    """Sums over the lines of a layer, or over any part of one.

    path_mm : length of the toolpath with the beam on
    beam_s : time for which the beam was on
    energy_J : beam energy over that time
    duration_s : machine time of the lines, travel included and holds left out
    powder_g : {hopper: mass fed by its disc in that time, from the first line with the beam on}
    """

    path_mm: float = 0.0
    beam_s: float = 0.0
    energy_J: float = 0.0
    duration_s: float = 0.0
    powder_g: Mapping[str, float] = field(default_factory=dict)

    def __add__(self, other: ExecutionFigures) -> ExecutionFigures:
        names = [*self.powder_g, *(name for name in other.powder_g if name not in self.powder_g)]
        return ExecutionFigures(
            self.path_mm + other.path_mm, self.beam_s + other.beam_s,
            self.energy_J + other.energy_J, self.duration_s + other.duration_s,
            {n: self.powder_g.get(n, 0.0) + other.powder_g.get(n, 0.0) for n in names},
        )

    def as_json(self) -> dict[str, Any]:
        """As a journal record carries them, rounded."""
        return {
            "path_mm": round(self.path_mm, _PATH_DECIMALS),
            "beam_s": round(self.beam_s, _TIME_DECIMALS),
            "energy_J": round(self.energy_J, _ENERGY_DECIMALS),
            "duration_s": round(self.duration_s, _TIME_DECIMALS),
            "powder_g": {n: round(g, _POWDER_DECIMALS) for n, g in self.powder_g.items()},
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> ExecutionFigures:
        """From a journal record. Raises KeyError, TypeError, ValueError for anything else."""
        return cls(
            float(values["path_mm"]), float(values["beam_s"]), float(values["energy_J"]),
            float(values["duration_s"]),
            {str(name): float(grams) for name, grams in dict(values["powder_g"]).items()},
        )


NO_FIGURES = ExecutionFigures()
