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

from simulators.array_types import FloatArray

#: Pieces kept, 32 bytes each: 14 h of a recipe every 0.1 s with ramps. Then the older half goes.
MAX_PIECES = 1 << 20


class SimulatedHose:
    """dead_time_s, lag_s : θ and τ; drive_lag_s : τ_d of the pieces. All ≥ 0."""

    def __init__(self, dead_time_s: float, lag_s: float, drive_lag_s: float) -> None:
        self._dead_time_s = dead_time_s
        self._lag_s = lag_s
        self._drive_lag_s = drive_lag_s
        self._pieces = array("d")  # start, c0, c1, c2; start, c0, ...
        self._first_y = 0.0  # what left the nozzle as the first kept piece reached it
        self._forgotten = False

    def add_inflow(self, start_s: float, c0: float, c1: float, c2: float) -> None:
        """From start_s on the hose is fed by this piece. Starts never fall."""
        self._pieces.extend((start_s, c0, c1, c2))
        if len(self._pieces) > 4 * MAX_PIECES:
            self._forget(MAX_PIECES // 2)

    def discard_from(self, time_s: float) -> None:
        """Drop pieces that have not begun before time_s: something else was commanded."""
        pieces = self._pieces
        while pieces and pieces[-4] >= time_s:
            del pieces[-4:]

    def outflow_g_s(self, time_s: FloatArray) -> FloatArray:
        """Flow out of the nozzle at each time, in any order and shape; 0 before the first piece.

        Raises ValueError for times so long ago that the pieces are no longer kept.
        """
        starts, c0, c1, c2 = self._columns()
        if not len(starts):
            return np.zeros_like(time_s, dtype=np.float64)
        entered_s = np.asarray(time_s, dtype=np.float64) - self._dead_time_s
        if self._forgotten and entered_s.size and entered_s.min() < starts[0]:
            raise ValueError(f"the flow before {starts[0] + self._dead_time_s:.1f} s is forgotten")
        first_y = self._first_outflows(starts, c0, c1, c2)
        piece = np.searchsorted(starts, entered_s, side="right") - 1
        known = np.maximum(piece, 0)
        x = entered_s - starts[known]
        y = self._fed(x, c0[known], c1[known], c2[known])
        if self._lag_s > 0:
            y += first_y[known] * np.exp(-np.maximum(x, 0.0) / self._lag_s)
        return np.where(piece >= 0, y, 0.0)

    def _first_outflows(
        self, starts: FloatArray, c0: FloatArray, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """Outflow as each piece reaches the nozzle: y ← y·exp(−Δ/τ) + answer to the piece."""
        if self._lag_s <= 0:
            return np.zeros_like(starts)
        length = np.diff(starts)
        decay = np.exp(-length / self._lag_s).tolist()
        gain = self._fed(length, c0[:-1], c1[:-1], c2[:-1]).tolist()
        y = self._first_y
        first_y = [y]
        for kept, gained in zip(decay, gain, strict=True):
            y = y * kept + gained
            first_y.append(y)
        return np.array(first_y)

    def _fed(self, x: FloatArray, c0: FloatArray, c1: FloatArray, c2: FloatArray) -> FloatArray:
        """Outflow x seconds into a piece, from an empty lag."""
        x = np.maximum(x, 0.0)
        lag, drive = self._lag_s, self._drive_lag_s
        drive_decay = np.exp(-x / drive) if drive > 0 else np.zeros_like(x)
        if lag <= 0:
            return c0 + c1 * x + c2 * drive_decay
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
                (drive_decay - (1.0 - rise)) / (difference if difference else 1.0),
            )
            y = y + c2 * both / lag
        return y

    def _forget(self, n: int) -> None:
        self._first_y = float(self._first_outflows(*self._columns())[n])
        del self._pieces[: 4 * n]
        self._forgotten = True

    def _columns(self) -> tuple[FloatArray, ...]:
        """Starts, c0, c1 and c2 of the pieces."""
        return tuple(np.array(self._pieces).reshape(-1, 4).T)
