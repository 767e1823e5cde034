"""The laser's own safety circuit: it forces the beam off whatever the controller commands.

The circuit is hardware beside the controller, which does not detect it: the beam goes off (stop
category 0), the axes keep moving.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from simulators.array_types import FloatArray

_T0, _T1, _DISTANCE, _SPEED, _ACCELERATION, _POWER = range(6)


class LaserSafetyCircuit:
    """The times when the circuit was open, and its effect on the recorded beam power."""

    def __init__(self) -> None:
        self._open: list[list[float]] = []  # from, to

    def open_at(self, when_s: float) -> None:
        """Beam off from when_s on, until the circuit is closed."""
        if not self._open or self._open[-1][1] < inf:
            self._open.append([when_s, inf])

    def close_at(self, when_s: float) -> None:
        if self._open and self._open[-1][1] == inf:
            self._open[-1][1] = when_s
            if when_s <= self._open[-1][0]:  # closed again before the source reacted
                self._open.pop()

    def is_open(self, times_s: FloatArray) -> NDArray[np.bool_]:
        """Whether the circuit is open at each time, (n,)."""
        off = np.zeros(len(times_s), dtype=bool)
        for from_s, to_s in self._open:
            off |= (times_s >= from_s) & (times_s < to_s)
        return off

    def split_phases(self, phases: FloatArray) -> FloatArray:
        """Phases (n, 7) of the recording, split where the circuit opens or closes."""
        for edge_s in (edge_s for span in self._open for edge_s in span):
            within = np.flatnonzero((phases[:, _T0] < edge_s) & (edge_s < phases[:, _T1]))
            for at in within[::-1]:
                phases = np.insert(phases, at + 1, phases[at], axis=0)
                first, rest = phases[at], phases[at + 1]
                dt = edge_s - first[_T0]
                rest[_DISTANCE] += (first[_SPEED] + 0.5 * first[_ACCELERATION] * dt) * dt
                rest[_SPEED] += first[_ACCELERATION] * dt
                first[_T1] = rest[_T0] = edge_s
        if self._open:
            phases[self.is_open(phases[:, _T0]), _POWER] = 0.0
        return phases

    def split_standstill(self, standstill: FloatArray) -> FloatArray:
        """Standing power (n, 2): start time and power, zero while the circuit is open."""
        for edge_s in (edge_s for span in self._open for edge_s in span if edge_s < inf):
            at = int(np.searchsorted(standstill[:, 0], edge_s, side="right"))
            power = standstill[at - 1, 1] if at else 0.0
            standstill = np.insert(standstill, at, (edge_s, power), axis=0)
        if self._open:
            standstill[self.is_open(standstill[:, 0]), 1] = 0.0
        return standstill
