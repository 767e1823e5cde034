"""Composition along a track: quantised, then laid piecewise-linearly between the quanta.

A stretch of track whose quantised composition stays the same is a *run*. The composition laid is
exactly a quantum in the middle of each run and linear in between, so that the feeders follow
slopes where a staircase would ask them for jumps; where the field itself jumps, it changes between
the two points of the track on either side. So it stays within 1.1 quanta of the field: 0.6 by
which a run lets the field leave its value, half of one where the change to the next has begun. On
even slopes it is no more than 0.6.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

#: In quanta: how far the field must leave a run's value to end it (½ would flicker with noise).
_HYSTERESIS = 0.6
#: In quanta: a field that changes by more between two points of a track jumps there.
_JUMP = 0.75


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
    quanta = max(1, round(1 / step))
    starts = np.asarray(_run_starts(fractions, rounded, _HYSTERESIS / quanta, _JUMP / quanta))
    return np.append(starts, len(fractions)), rounded[starts]


def ends_of_runs(along_mm: FloatArray, bounds: IntArray) -> FloatArray:
    """Where runs begin and end along the track, (r + 1,) [mm]: half-way between its points."""
    edges = (along_mm[bounds[1:-1] - 1] + along_mm[bounds[1:-1]]) / 2
    return np.concatenate([along_mm[:1], edges, along_mm[-1:]])


def knots(
    along_mm: FloatArray, fractions: FloatArray, bounds: IntArray, levels: FloatArray, step: float
) -> tuple[FloatArray, FloatArray]:
    """Lengths along the track (q,) and mixtures (q, m) between which the mixture is linear.

    At each edge between runs it changes over the nearer halves of both, as wide on either side:
    even slopes become one slope, and a plateau stays flat up to its end. A jump of the field is
    one of the mixture, as wide as the two points of the track beside it are apart.

    along_mm, fractions : (k,), (k, m) the track's points; bounds, levels : its runs
    """
    ends = ends_of_runs(along_mm, bounds)
    edges, half = ends[1:-1], np.diff(ends) / 2
    last, first = bounds[1:-1] - 1, bounds[1:-1]
    reach = np.minimum(half[1:], half[:-1])
    jumps = np.abs(fractions[first] - fractions[last]).max(axis=1) > _JUMP / max(1, round(1 / step))
    reach = np.where(jumps, np.minimum(reach, (along_mm[first] - along_mm[last]) / 2), reach)
    at = np.concatenate([ends[:1] + half[:1], np.stack(
        [edges - reach, edges + reach], axis=1).ravel()])
    owner = np.arange(len(at)) // 2
    keep = np.append(True, np.diff(at) > 1e-9)
    return at[keep], levels[owner[keep]]


@njit(cache=True)
def _run_starts(
    fractions: FloatArray, rounded: FloatArray, reach: float, jump: float
) -> NDArray[np.int64]:
    """A run ends where the field leaves it, and at a jump even if that stays in its quantum."""
    starts = [0]
    now = 0
    for i in range(1, len(fractions)):
        away, leap, changed = 0.0, 0.0, False
        for m in range(fractions.shape[1]):
            away = max(away, abs(fractions[i, m] - rounded[now, m]))
            leap = max(leap, abs(fractions[i, m] - fractions[i - 1, m]))
            changed = changed or rounded[i, m] != rounded[now, m]
        if leap > jump or (away > reach and changed):
            starts.append(i)
            now = i
    return np.array(starts)
