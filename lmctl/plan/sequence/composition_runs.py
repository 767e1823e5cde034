"""Composition along tracks: quantised, then deposited piecewise-linearly between the quanta.

A length of track whose quantised composition stays the same is a *run*. The composition deposited
is exactly a quantum in the middle of each run and linear in between, so that the feeders follow
slopes where a staircase would command jumps; where the field itself jumps, it changes between
the two points of the track on either side. So it stays within 1.1 quanta of the field: 0.6 by
which a run lets the field leave its value, half of one where the change to the next has begun. On
even slopes it is no more than 0.6.

All tracks of a layer are worked on at once; `along_mm` addresses places on them as in
`track_order.OrderedTracks`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel

#: In quanta: how far the field must leave a run's value to end it (½ would flicker with noise).
_HYSTERESIS = 0.6
#: In quanta: a field that changes by more between two points of a track jumps there.
_JUMP = 0.75


@dataclass(frozen=True)
class CompositionRuns:
    """r runs of m tracks.

    bounds : (r + 1,) rising; run j is vertices bounds[j] to bounds[j + 1]
    track : (r,) which track it is on
    levels : (r, materials) float64, its quantised composition
    """

    bounds: IndexArray
    track: IndexArray
    levels: FloatArray


def quantised_fractions(fractions: FloatArray, step: float) -> FloatArray:
    """Volume fractions as multiples of 1/round(1/step) that sum to 1, by largest remainder.

    fractions : (n, m) float64, ≥ 0, rows summing to 1; returns the same shape, each value within
        one quantum of what it was (half a quantum for two materials)
    """
    quanta = max(1, round(1 / step))
    scaled = fractions / fractions.sum(axis=1, keepdims=True) * quanta
    floor = np.floor(scaled + 1e-9)
    missing = np.rint(quanta - floor.sum(axis=1)).astype(int)
    rank = np.argsort(np.argsort(-(scaled - floor), axis=1, kind="stable"), axis=1)
    floor += rank < missing[:, None]
    return np.asarray(floor / quanta)


def composition_runs(
    fractions: FloatArray, starts: IndexArray, step: float
) -> CompositionRuns:
    """Runs of one quantised composition along m tracks.

    fractions : (n, materials) float64, the field at the tracks' vertices; starts : (m + 1,)
    """
    first = starts[:-1]
    span = (np.maximum.reduceat(fractions, first) - np.minimum.reduceat(fractions, first)).max(1)
    steady = span <= step / 2
    size = np.diff(starts)
    rounded = np.zeros_like(fractions)
    varying = ~np.repeat(steady, size)
    rounded[varying] = quantised_fractions(fractions[varying], step)
    mean = np.add.reduceat(fractions, first) / size[:, None]
    rounded[first[steady]] = quantised_fractions(mean[steady], step)
    quanta = max(1, round(1 / step))
    begins = np.asarray(_run_starts(
        fractions, rounded, starts, steady, _HYSTERESIS / quanta, _JUMP / quanta))
    return CompositionRuns(
        np.append(begins, starts[-1]), np.searchsorted(starts, begins, side="right") - 1,
        rounded[begins])


def run_ends_mm(along_mm: FloatArray, starts: IndexArray, runs: CompositionRuns) -> FloatArray:
    """Where each run begins and ends, (r, 2) [mm]: half-way between vertices, or a track's end."""
    first, last = runs.bounds[:-1], runs.bounds[1:] - 1
    ends = np.column_stack([along_mm[first], along_mm[last]])
    inner = np.flatnonzero(runs.track[1:] == runs.track[:-1])
    ends[inner, 1] = ends[inner + 1, 0] = (ends[inner, 1] + ends[inner + 1, 0]) / 2
    return ends


def composition_knots(
    along_mm: FloatArray, fractions: FloatArray, starts: IndexArray, runs: CompositionRuns,
    step: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths (q,) and mixtures (q, materials) between which the mixture is linear, and where
    a bead needs a vertex for it, (k,) rising.

    At each edge between runs it changes over the nearer halves of both, as wide on either side:
    even slopes become one slope, and a plateau stays flat up to its end. A jump of the field is
    one of the mixture, as wide as the two vertices beside it are apart. The vertices are the
    knots and the edges themselves: with these no line's mixture is more than half a quantum from
    that at its end.
    """
    ends = run_ends_mm(along_mm, starts, runs)
    edge = np.flatnonzero(runs.track[1:] == runs.track[:-1])
    half = np.diff(ends, axis=1)[:, 0] / 2
    last, first = runs.bounds[edge + 1] - 1, runs.bounds[edge + 1]
    reach = np.minimum(half[edge], half[edge + 1])
    jump = np.abs(fractions[first] - fractions[last]).max(axis=1, initial=0.0)
    wide = (along_mm[first] - along_mm[last]) / 2
    reach = np.where(jump > _JUMP / max(1, round(1 / step)), np.minimum(reach, wide), reach)
    place = ends[edge, 1]
    at = np.concatenate([along_mm[starts[:-1]], place - reach, place + reach,
                         along_mm[starts[1:] - 1]])
    new_track = np.append(True, runs.track[1:] != runs.track[:-1])
    owner = np.concatenate([np.flatnonzero(new_track), edge, edge + 1,
                            np.flatnonzero(np.append(new_track[1:], True))])
    # Equal lengths stay in the order of their runs.
    order = np.lexsort((owner, at))
    at, owner = at[order], owner[order]
    keep = np.append(True, np.diff(at) > 1e-9)
    vertices = np.unique(np.concatenate([place - reach, place, place + reach]))
    return at[keep], runs.levels[owner[keep]], vertices


@kernel
def _run_starts(
    fractions: FloatArray, rounded: FloatArray, starts: IndexArray, steady: NDArray[np.bool_],
    reach: float, jump: float,
) -> NDArray[np.int64]:
    """A run ends where the field leaves it, and at a jump even if that stays in its quantum."""
    found = np.empty(len(fractions), np.int64)
    count = 0
    for track in range(len(steady)):
        now = starts[track]
        found[count] = now
        count += 1
        if steady[track]:
            continue
        for i in range(starts[track] + 1, starts[track + 1]):
            away, leap, changed = 0.0, 0.0, False
            for m in range(fractions.shape[1]):
                away = max(away, abs(fractions[i, m] - rounded[now, m]))
                leap = max(leap, abs(fractions[i, m] - fractions[i - 1, m]))
                changed = changed or rounded[i, m] != rounded[now, m]
            if leap > jump or (away > reach and changed):
                found[count] = i
                count += 1
                now = i
    return found[:count]
