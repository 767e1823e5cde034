"""Composition along tracks: quantised, then deposited piecewise-linearly between the quanta.

A length of track whose quantised composition stays the same is a *run*. The composition deposited
is exactly a quantum in the middle of each run and linear in between, so that the feeders follow
slopes where a staircase would command jumps; where the field itself jumps, it changes between
the two points of the track on either side. A track along which the mixture does not change has its
own, more finely. So it stays within 1.1 quanta of the field: 0.6 by
which a run lets the field leave its value, half of one where the change to the next has begun. On
even slopes it is no more than 0.6.

All tracks of a layer are worked on at once; `along_mm` addresses places on them as in
`track_order.OrderedTracks`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel

#: In quanta: how far the field must leave a run's value to end it (½ would flicker with noise).
_HYSTERESIS = 0.6
#: In quanta: a field that changes by more between two points of a track jumps there.
_JUMP = 0.75
#: A track of one mixture has it to this part of a quantum: steps along a path need knots, and so
#: lines of the program; a track without steps needs none, and half a quantum would be off for
#: nothing.
_STEADY_PARTS = 10


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
    return np.asarray(_quantised(
        np.ascontiguousarray(fractions, dtype=np.float64), max(1, round(1 / step))))


def composition_runs(
    fractions: FloatArray, starts: IndexArray, step: float
) -> CompositionRuns:
    """Runs of one quantised composition along m tracks.

    fractions : (n, materials) float64, the field at the tracks' vertices; starts : (m + 1,)
    """
    quanta = max(1, round(1 / step))
    begins, levels = _runs(
        np.ascontiguousarray(fractions), starts, step / 2, quanta, _HYSTERESIS / quanta,
        _JUMP / quanta)
    return CompositionRuns(
        np.append(begins, starts[-1]), np.searchsorted(starts, begins, side="right") - 1,
        np.asarray(levels))


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


@inner_kernel
def _quantise(row: FloatArray, fractions: FloatArray, quanta: int, left: FloatArray) -> None:
    """Set a row (m,) to volume fractions in quanta, by largest remainder; left : (m,) to work in"""
    total = 0.0
    for m in range(len(row)):
        total += fractions[m]
    missing = float(quanta)
    for m in range(len(row)):
        scaled = fractions[m] / total * quanta
        row[m] = np.floor(scaled + 1e-9)
        left[m] = scaled - row[m]
        missing -= row[m]
    for _ in range(min(int(np.rint(missing)), len(row))):
        most = 0
        for m in range(1, len(row)):
            if left[m] > left[most]:
                most = m
        row[most] += 1.0
        left[most] = -np.inf
    for m in range(len(row)):
        row[m] /= quanta


@kernel
def _quantised(fractions: FloatArray, quanta: int) -> FloatArray:
    rounded = np.empty_like(fractions)
    left = np.empty(fractions.shape[1])
    for k in range(len(fractions)):
        _quantise(rounded[k], fractions[k], quanta, left)
    return rounded


@kernel
def _runs(
    fractions: FloatArray, starts: IndexArray, steady_span: float, quanta: int, reach: float,
    jump: float,
) -> tuple[IndexArray, FloatArray]:
    """First vertex (r,) and quantised composition (r, materials) of each run.

    A run ends where the field leaves it, and at a jump even if that stays in its quantum. A track
    whose fractions all lie within `steady_span` is one run of its mean, to `_STEADY_PARTS` of a
    quantum.
    """
    n, materials = fractions.shape
    begins, levels = np.empty(n, np.int64), np.empty((n, materials))
    low, high, mean = np.empty(materials), np.empty(materials), np.empty(materials)
    here, left = np.empty(materials), np.empty(materials)
    count = 0
    for track in range(len(starts) - 1):
        first, end = starts[track], starts[track + 1]
        for m in range(materials):
            low[m] = high[m] = mean[m] = fractions[first, m]
        for k in range(first + 1, end):
            for m in range(materials):
                value = fractions[k, m]
                low[m], high[m] = min(low[m], value), max(high[m], value)
                mean[m] += value
        span = 0.0
        for m in range(materials):
            span = max(span, high[m] - low[m])
            mean[m] /= end - first
        begins[count] = first
        if span <= steady_span:
            _quantise(levels[count], mean, quanta * _STEADY_PARTS, left)
            count += 1
            continue
        _quantise(levels[count], fractions[first], quanta, left)
        for k in range(first + 1, end):
            away, leap = 0.0, 0.0
            for m in range(materials):
                away = max(away, abs(fractions[k, m] - levels[count, m]))
                leap = max(leap, abs(fractions[k, m] - fractions[k - 1, m]))
            if leap <= jump and away <= reach:
                continue
            _quantise(here, fractions[k], quanta, left)
            changed = leap > jump
            for m in range(materials):
                changed = changed or here[m] != levels[count, m]
            if changed:
                count += 1
                begins[count] = k
                for m in range(materials):
                    levels[count, m] = here[m]
        count += 1
    return begins[:count].copy(), levels[:count].copy()
