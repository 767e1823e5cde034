"""The hose: powder that enters at the disc leaves at the nozzle, delayed and smoothed.

Source: docs/explanation/powder-delivery.md, Transport delay and lag.

Flow into the hose is recorded as pieces s(x) = c0 + c1·x + c2·exp(−x/τ_d), x the time since the
piece began: what a disc with a first-order drive (τ_d) makes of a stepwise or ramped set-point.
The nozzle sees τ·y′ = s(t − θ) − y, which has a closed solution for each piece. Nothing is stepped
in time, however long the history, and the flow at any past instant can be computed.
"""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from simulators.array_types import FloatArray

#: Pieces kept, 48 bytes each: 14 h of a recipe every 0.1 s with ramps. Then the older half goes.
MAX_PIECES = 1 << 20

_COLUMNS = 6  # start, arrival, lag, c0, c1, c2


class SimulatedHose:
    """dead_time_s, lag_s : θ and τ; drive_lag_s : τ_d of the pieces. All ≥ 0."""

    def __init__(self, dead_time_s: float, lag_s: float, drive_lag_s: float) -> None:
        self._dead_time_s = dead_time_s
        self._lag_s = lag_s
        self._drive_lag_s = drive_lag_s
        self._pieces = array("d")  # rows of _COLUMNS
        self._first_y = 0.0  # what left the nozzle as the first kept piece reached it
        self._first_g = 0.0  # what had entered before the first kept piece
        self._forgotten = False

    def set_transport(self, dead_time_s: float, lag_s: float) -> None:
        """Set θ and τ of the pieces added from now on; no powder overtakes what went before it."""
        self._dead_time_s, self._lag_s = dead_time_s, lag_s

    def add_inflow(self, start_s: float, c0: float, c1: float, c2: float) -> None:
        """From start_s on the hose is fed by this piece. Starts never fall."""
        arrival_s = start_s + self._dead_time_s
        if self._pieces:
            arrival_s = max(arrival_s, self._pieces[1 - _COLUMNS])
        self._pieces.extend((start_s, arrival_s, self._lag_s, c0, c1, c2))
        if len(self._pieces) > _COLUMNS * MAX_PIECES:
            self._forget(MAX_PIECES // 2)

    def discard_from(self, time_s: float) -> None:
        """Drop pieces that have not begun before time_s: something else was commanded."""
        pieces = self._pieces
        while pieces and pieces[-_COLUMNS] >= time_s:
            del pieces[-_COLUMNS:]

    def outflow_g_s(self, time_s: FloatArray) -> FloatArray:
        """Flow out of the nozzle at each time, in any order and shape; 0 before the first piece.

        Raises ValueError for times so long ago that the pieces are no longer kept.
        """
        if not self._pieces:
            return np.zeros_like(time_s, dtype=np.float64)
        _, arrival, lag, c0, c1, c2 = self._columns()
        piece, x = self._piece_at(np.asarray(time_s, dtype=np.float64), arrival)
        y = self._fed(x, lag[piece], c0[piece], c1[piece], c2[piece])
        first_y = self._first_outflows(arrival, lag, c0, c1, c2)[piece]
        y += first_y * _decay(np.maximum(x, 0.0), lag[piece])
        return np.where(x >= 0, y, 0.0)

    def arrived_g(self, time_s: FloatArray) -> FloatArray:
        """Powder that has come through the dead time by each time, before the lag; any shape."""
        if not self._pieces:
            return np.zeros_like(time_s, dtype=np.float64)
        _, arrival, _, c0, c1, c2 = self._columns()
        whole = self._mass(np.diff(arrival), c0[:-1], c1[:-1], c2[:-1])
        before = self._first_g + np.concatenate([[0.0], np.cumsum(whole)])
        piece, x = self._piece_at(np.asarray(time_s, dtype=np.float64), arrival)
        x = np.maximum(x, 0.0)
        return np.asarray(before[piece] + self._mass(x, c0[piece], c1[piece], c2[piece]))

    def _piece_at(
        self, time_s: FloatArray, arrival: FloatArray
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """The piece that arrives at each time and since when; below 0 before the first."""
        if self._forgotten and time_s.size and time_s.min() < arrival[0]:
            raise ValueError(f"the flow before {arrival[0]:.1f} s is forgotten")
        piece = np.maximum(np.searchsorted(arrival, time_s, side="right") - 1, 0)
        return piece, time_s - arrival[piece]

    def _first_outflows(
        self, arrival: FloatArray, lag: FloatArray, c0: FloatArray, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """Outflow as each piece reaches the nozzle: y ← y·exp(−Δ/τ) + answer to the piece."""
        length = np.diff(arrival)
        decay = _decay(length, lag[:-1]).tolist()
        gain = self._fed(length, lag[:-1], c0[:-1], c1[:-1], c2[:-1]).tolist()
        y = self._first_y
        first_y = [y]
        for kept, gained in zip(decay, gain, strict=True):
            y = y * kept + gained
            first_y.append(y)
        return np.array(first_y)

    def _fed(
        self, x: FloatArray, lag: FloatArray, c0: FloatArray, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """Outflow x seconds into a piece, from an empty lag."""
        x = np.maximum(x, 0.0)
        drive = self._drive_lag_s
        drive_decay = np.exp(-x / drive) if drive > 0 else np.zeros_like(x)
        lagged = lag > 0
        if not lagged.any():
            return np.asarray(c0 + c1 * x + c2 * drive_decay)
        lag = np.where(lagged, lag, 1.0)
        rise = -np.expm1(-x / lag)
        y = c0 * rise + c1 * (x - lag * rise)
        if drive > 0:
            # ∫ exp(−(x−z)/τ)·exp(−z/τ_d) dz / τ; the quotient is 0/0 where both lags are equal
            difference = 1.0 / lag - 1.0 / drive
            exponent = difference * x
            near = np.abs(exponent) < 1e-6
            both = np.where(
                near,
                x * (1.0 - rise) * (1.0 + exponent / 2),
                (drive_decay - (1.0 - rise)) / np.where(difference == 0, 1.0, difference),
            )
            y = y + c2 * both / lag
        return np.where(lagged, y, c0 + c1 * x + c2 * drive_decay)

    def _mass(self, x: FloatArray, c0: FloatArray, c1: FloatArray, c2: FloatArray) -> FloatArray:
        """Powder that a piece brings in its first x seconds."""
        mass = c0 * x + c1 * x * x / 2
        if self._drive_lag_s > 0:
            mass = mass - c2 * self._drive_lag_s * np.expm1(-x / self._drive_lag_s)
        return np.asarray(mass)

    def _forget(self, n: int) -> None:
        _, arrival, lag, c0, c1, c2 = self._columns()
        self._first_y = float(self._first_outflows(arrival, lag, c0, c1, c2)[n])
        self._first_g += float(
            self._mass(np.diff(arrival)[:n], c0[:n], c1[:n], c2[:n]).sum())
        del self._pieces[: _COLUMNS * n]
        self._forgotten = True

    def _columns(self) -> tuple[FloatArray, ...]:
        """Starts, arrivals, lags, c0, c1 and c2 of the pieces."""
        return tuple(np.array(self._pieces).reshape(-1, _COLUMNS).T)


def _decay(x: FloatArray, lag: FloatArray) -> FloatArray:
    """What is left of an outflow after x seconds; nothing where there is no lag."""
    return np.where(lag > 0, np.exp(-x / np.where(lag > 0, lag, 1.0)), 0.0)
