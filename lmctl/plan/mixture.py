"""Composition along a track: quantised, then laid piecewise-linearly between the quanta.

A stretch of track whose quantised composition stays the same is a *run*. The composition laid is
exactly a quantum in the middle of each run and linear in between, so that the feeders follow
slopes where a staircase would ask them for jumps; it stays within half a quantum of the field.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

#: In quanta: how far the field must leave a run's value to end it (½ would flicker with noise).
_HYSTERESIS = 0.6


def quantised(fractions: FloatArray, step: float) -> FloatArray:
    """Volume fractions as multiples of 1/round(1/step) that sum to 1, by largest remainder.

    fractions : (n, m) float64, ≥ 0, rows summing to 1; returns the same shape, each value within
        one quantum of what it was (half a quantum for two materials)
    """
    quanta = max(1, round(1 / step))
    scaled = fractions / fractions.sum(axis=1, keepdims=True) * quanta
    whole = np.floor(scaled + 1e-9)
    missing = np.rint(quanta - whole.sum(axis=1)).astype(int)
    rank = np.argsort(np.argsort(-(scaled - whole), axis=1, kind="stable"), axis=1)
    whole += rank < missing[:, None]
    return np.asarray(whole / quanta)


def runs(fractions: FloatArray, step: float) -> tuple[IntArray, FloatArray]:
    """Stretches of one quantised composition along a track.

    fractions : (k, m) float64, the field at the track's points
    returns : (r + 1,) rising indices, run j being points [i_j, i_{j+1}); (r, m) its composition
    """
    steady = np.ptp(fractions, axis=0).max() <= step / 2
    if steady:
        mean = fractions.mean(axis=0, keepdims=True)
        return np.array([0, len(fractions)]), quantised(mean, step)
    rounded = quantised(fractions, step)
    starts = np.asarray(_run_starts(fractions, rounded, _HYSTERESIS / max(1, round(1 / step))))
    return np.append(starts, len(fractions)), rounded[starts]


@njit(cache=True)
def _run_starts(
    fractions: FloatArray, rounded: FloatArray, reach: float
) -> NDArray[np.int64]:
    starts = [0]
    now = 0
    for i in range(1, len(fractions)):
        away = 0.0
        for m in range(fractions.shape[1]):
            away = max(away, abs(fractions[i, m] - rounded[now, m]))
        if away > reach:
            changed = False
            for m in range(fractions.shape[1]):
                changed = changed or rounded[i, m] != rounded[now, m]
            if changed:
                starts.append(i)
                now = i
    return np.array(starts)
