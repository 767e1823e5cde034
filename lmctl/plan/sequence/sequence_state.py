"""State of the sequence stage between two layers."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.array_types import FloatArray


@dataclass(frozen=True)
class SequenceState:
    """State of planning between two layers.

    at_mm : (3,) the nozzle, in program coordinates; time_s : program time
    line, path : numbers of the next line and the next path
    mixture : (materials,) deposited last; flow_g_s : (hoppers,); None before the first bead
    first_bead_s : when the last layer's first bead began, None before the first
    """

    at_mm: FloatArray
    time_s: float = 0.0
    line: int = 0
    path: int = 0
    mixture: FloatArray | None = None
    flow_g_s: FloatArray | None = None
    first_bead_s: float | None = None
