"""Predict the flow at the nozzle from held set-points, for hoppers as they are supposed to be.

A hopper feeds offset + slope · set-point while its disc turns; the drive follows with a lag, the
hose with a dead time θ and a first-order lag τ. Between changes of set-points all of it is exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.sequence.held_setpoints import HopperValues, SetpointChanges

#: A lag below this is none [s].
_NO_LAG_S = 1e-6
#: Lags nearer to each other than this share are spread: the closed form divides by differences.
_LEAST_SPREAD = 1e-3
#: After so many lags nothing is left of what was before.
_SETTLED_LAGS = 12.0


@dataclass(frozen=True)
class CellValues:
    """What a cell is supposed to be; (hoppers,) float64 each, but for the dilution.

    dead_time_s, lag_s, drive_lag_s : of hose and drive
    slope, offset_g_min : what is fed is offset + slope · set-point
    catch_efficiency : of its powder, in (0, 1]
    dilution_off : by which every dilution differs from the one planned with
    """

    dead_time_s: FloatArray
    lag_s: FloatArray
    drive_lag_s: FloatArray
    slope: FloatArray
    offset_g_min: FloatArray
    catch_efficiency: FloatArray
    dilution_off: float = 0.0

    @classmethod
    def believed(
        cls, hoppers: Sequence[HopperValues], catch_efficiency: FloatArray
    ) -> CellValues:
        """As the profile has them; a drive lag is part of their lag."""
        def column(values: Sequence[float]) -> FloatArray:
            return np.array(values, dtype=np.float64)

        return cls(
            column([h.dead_time_s for h in hoppers]), column([h.lag_s for h in hoppers]),
            np.zeros(len(hoppers)), column([h.slope for h in hoppers]),
            column([h.offset_g_min for h in hoppers]), catch_efficiency)

    def settling_s(self) -> float:
        """After so long a change of set-point has come through, of every hopper."""
        return float((self.dead_time_s + _SETTLED_LAGS * (self.lag_s + self.drive_lag_s)).max())


def nozzle_flow_g_s(changes: SetpointChanges, values: CellValues, at_s: FloatArray) -> FloatArray:
    """Flow of each hopper at the nozzle, (q, hoppers) [g/s].

    at_s : (q,) rising program times. The first set-point of `changes` holds since long before
    """
    flow = np.empty((len(at_s), len(values.slope)))
    for hopper in range(len(values.slope)):
        setpoint = changes.setpoint_g_min[:, hopper]
        fed = np.where(setpoint > 0.0, np.maximum(
            values.offset_g_min[hopper] + values.slope[hopper] * setpoint, 0.0), 0.0) / 60.0
        flow[:, hopper] = hopper_outflow(changes.time_s, fed, values, hopper, at_s)
    return flow


def hopper_outflow(
    time_s: FloatArray, fed: FloatArray, values: CellValues, hopper: int, at_s: FloatArray
) -> FloatArray:
    """What comes through the drive and the hose of one hopper, (q,), in the unit of `fed`.

    time_s, fed : (k,) rising times, and what it is fed from each on
    """
    lag, slower = sorted((max(float(values.lag_s[hopper]), _NO_LAG_S),
                          max(float(values.drive_lag_s[hopper]), _NO_LAG_S)))
    return np.asarray(_outflow(time_s + values.dead_time_s[hopper], np.ascontiguousarray(fed), lag,
                               max(slower, lag * (1.0 + _LEAST_SPREAD)), at_s))


@kernel
def _outflow(
    arrival: FloatArray, fed: FloatArray, lag: float, slower: float, at: FloatArray
) -> FloatArray:
    """Outflow of two lags in a row, `lag` < `slower`, at rising times.

    Fed u since x = 0: the first lag's outflow is v = u + (v₀ − u)·e^(−x/a), and the second's
    y = u + (y₀ − u)·e^(−x/b) + (v₀ − u)·a/(a − b)·(e^(−x/a) − e^(−x/b)).
    """
    flow = np.empty(len(at))
    ratio = lag / (lag - slower)
    v = y = fed[0]
    since = arrival[0]
    k = 0
    for i in range(len(at)):
        while k + 1 < len(arrival) and arrival[k + 1] <= at[i]:
            x = arrival[k + 1] - since
            fast, slow = math.exp(-x / lag), math.exp(-x / slower)
            u = fed[k]
            y = u + (y - u) * slow + (v - u) * ratio * (fast - slow)
            v = u + (v - u) * fast
            since = arrival[k + 1]
            k += 1
        x = max(at[i] - since, 0.0)
        fast, slow = math.exp(-x / lag), math.exp(-x / slower)
        u = fed[k]
        flow[i] = u + (y - u) * slow + (v - u) * ratio * (fast - slow)
    return flow
