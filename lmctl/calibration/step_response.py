"""What a scale shows of stepped powder: dead time, then a chain of first-order lags.

The nozzle's flow after a set-point step from u0 to u1 at s is
q(t) = q0 + (q1 − q0)·h(t − s − θ), h the step response of the lags in a row. The scale shows the
integral of it through its own lag, which is one more link of the same chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray

#: Lags nearer to each other than this share are spread: the closed form divides by differences.
_LEAST_SPREAD = 1e-3
#: A lag below this passes everything at once [s].
_NO_LAG_S = 1e-4


@dataclass(frozen=True)
class SetpointHistory:
    """Set-points of one hopper: levels held from one time to the next.

    time_s : (k,) float64, rising; when each level was set. The first holds since long before
    flow_g_min : (k,) float64, the levels
    """

    time_s: FloatArray
    flow_g_min: FloatArray

    def __post_init__(self) -> None:
        if len(self.time_s) != len(self.flow_g_min) or len(self.time_s) < 1:
            raise ValueError("a history needs a time for each level, and one level at least")
        if np.any(np.diff(self.time_s) <= 0):
            raise ValueError("the times of a history must rise")

    @property
    def step_count(self) -> int:
        """Steps after the first level."""
        return len(self.time_s) - 1

    @property
    def lowest_over_highest(self) -> float:
        """Ratio of the least level to the greatest."""
        return float(self.flow_g_min.min() / self.flow_g_min.max())


def lag_weights(lags_s: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Lags that count, spread where equal, and their weights A: h(x) = 1 − Σ A_j exp(−x/τ_j).

    returns : (m,) lags [s] and (m,) weights, both empty where nothing lags
    """
    lags = np.sort(np.array([lag for lag in lags_s if lag > _NO_LAG_S], dtype=np.float64))
    for at in range(1, len(lags)):
        lags[at] = max(lags[at], lags[at - 1] * (1.0 + _LEAST_SPREAD))
    weights = np.ones_like(lags)
    for at, lag in enumerate(lags):
        others = np.delete(lags, at)
        weights[at] = np.prod(lag / (lag - others))
    return lags, weights


def step_response(x_s: FloatArray, lags_s: Sequence[float]) -> FloatArray:
    """Response of the chain to a unit step at 0: 0 before it, 1 long after.

    x_s : any shape, float64; lags_s : time constants in a row [s], each ≥ 0
    returns : shape of x_s
    """
    lags, weights = lag_weights(lags_s)
    x = np.maximum(np.asarray(x_s, np.float64), 0.0)
    h = np.ones_like(x)
    for lag, weight in zip(lags, weights, strict=True):
        h -= weight * np.exp(x / -lag)
    return np.where(np.asarray(x_s) < 0, 0.0, h)


def integrated_step_response(x_s: FloatArray, lags_s: Sequence[float]) -> FloatArray:
    """Integral of `step_response` from 0 to x [s]; 0 for x < 0.

    >>> float(integrated_step_response(np.array([50.0]), [1.0, 0.5])[0])
    48.5
    """
    lags, weights = lag_weights(lags_s)
    x = np.maximum(np.asarray(x_s, np.float64), 0.0)
    for lag, weight in zip(lags, weights, strict=True):
        x = x + weight * lag * np.expm1(np.maximum(x_s, 0.0) / -lag)
    return x


def nozzle_flow_g_min(
    time_s: FloatArray, history: SetpointHistory, *, dead_time_s: float, lags_s: Sequence[float],
    slope: float, offset_g_min: float,
) -> FloatArray:
    """Flow at the nozzle. time_s : (n,); returns (n,) float64 [g/min]."""
    levels = offset_g_min + slope * history.flow_g_min
    flow = np.full(len(time_s), levels[0])
    if history.step_count:
        late = time_s[:, None] - history.time_s[None, 1:] - dead_time_s
        flow += step_response(late, lags_s) @ np.diff(levels)
    return flow


def displayed_mass_g(
    time_s: FloatArray, history: SetpointHistory, *, dead_time_s: float, lags_s: Sequence[float],
    slope: float, offset_g_min: float,
) -> FloatArray:
    """Mass that a scale shows, but for a constant.

    time_s : (n,) float64; lags_s : of the powder's way and of the scale
    slope : true flow per set flow; offset_g_min : true flow at set-point 0, by the line
    returns : (n,) float64 [g]
    """
    levels_g_s = (offset_g_min + slope * history.flow_g_min) / 60.0
    mass = levels_g_s[0] * (time_s - time_s[0])
    if history.step_count:
        late = time_s[:, None] - history.time_s[None, 1:] - dead_time_s
        mass += integrated_step_response(late, lags_s) @ np.diff(levels_g_s)
    return np.asarray(mass)
