"""From a trace to a bead: as few vertices as shape and mixture allow, and the speed between them.

The volume a millimetre takes is share · layer height. The powder volume per second is kept at the
recipe's, and what a share differs from the nominal pitch is made up by speed, which follows at
once where powder comes seconds late.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.mixture import ends_of_runs, knots, runs
from lmctl.plan.order import Trace
from lmctl.plan.polyline import arc_lengths, at_lengths, densified, simplified
from lmctl.plan.powder import limits_of
from lmctl.plan.ramps import followed
from lmctl.plan.recipe import Recipe

FloatArray = NDArray[np.float64]

#: Simplifying a path moves it by no more than this part of the bead width,
_TOLERANCE = 0.01
#: and its share by no more than this part of the pitch.
_SHARE_TOLERANCE = 0.03
#: Speed differs from the recipe's by at most this factor, to level the volume.
MOST_LEVELLING = 1.5
#: Segments are made to last this part of what a line may: corners take time.
_FILL = 0.9
#: Volume fraction within which a predicted mixture counts as right (process.md 2.3).
TOLERANCE_FRACTION = 0.02
#: Where the mixture changes too fast along a path, the path is slowed down, but not below this.
PACES = (1.0, 0.85, 0.7, 0.6, 0.5)
#: A slower pace has to leave no more than this part of the time for which the powder is off.
_WORTH = 0.9


@dataclass(frozen=True)
class Bead:
    """A path to lay with the beam on; v vertices, v − 1 segments.

    points : (v, 2) float64 [mm]; fractions : (v, m) float64
    speed_mm_s, power_W : (v − 1,) float64
    pace : factor on the recipe's speed, powder and power, for the whole path
    snapped_mm : length whose mixture was moved to what the hoppers can meter
    snapped_by : by how much at most, volume fraction
    """

    points: FloatArray
    fractions: FloatArray
    speed_mm_s: FloatArray
    power_W: FloatArray
    pace: float
    snapped_mm: float
    snapped_by: float

    @property
    def length_mm(self) -> float:
        return float(arc_lengths(self.points)[-1])


def make_bead(
    trace: Trace, recipe: Recipe, step: float, longest_s: float, max_speed_mm_s: float, where: str,
    *, leads: bool,
) -> Bead:
    """The bead of a trace.

    step : quantum of volume fraction; longest_s : most a segment may last
    leads : whether powder is led, so that slowing down can help it follow
    Raises PlanError where no hopper can deliver what it needs.
    """
    bounds, wanted = runs(trace.fractions, step)
    levels = recipe.deliverable(wanted)
    recipe.check_deliverable(levels, where)
    along = arc_lengths(trace.points)
    turns, laid = knots(along, trace.fractions, bounds, levels, step)
    off = np.abs(levels - wanted).max(axis=1)
    at = _vertices(trace, along, turns, recipe)
    slowest = (recipe.speed(levels).min() * _levelling(trace, along, at, recipe).min())
    at = densified(np.column_stack([at, np.zeros(len(at))]), _FILL * longest_s * slowest)[:, 0]
    fractions = np.column_stack([
        np.interp(at, turns, laid[:, m]) for m in range(levels.shape[1])])
    middle = (fractions[1:] + fractions[:-1]) / 2
    bead = Bead(
        points=at_lengths(trace.points, at),
        fractions=fractions,
        speed_mm_s=recipe.speed(middle) * _levelling(trace, along, at, recipe),
        power_W=recipe.power(middle),
        pace=1.0,
        snapped_mm=float(np.diff(ends_of_runs(along, bounds))[off > step / 2].sum()),
        snapped_by=float(off.max()),
    )
    bead = _within_reach(bead, recipe, max_speed_mm_s)
    return _slowed(bead, recipe) if leads and len(levels) > 1 else bead


def _levelling(
    trace: Trace, along: FloatArray, at: FloatArray, recipe: Recipe
) -> FloatArray:
    """Factor on the speed between vertices `at` (v,), (v − 1,): nominal pitch over the share."""
    share = np.interp(at, along, trace.share_mm)
    return np.clip(
        recipe.pitch_mm * 2 / (share[1:] + share[:-1]), 1 / MOST_LEVELLING, MOST_LEVELLING)


def _vertices(
    trace: Trace, along: FloatArray, knots: FloatArray, recipe: Recipe
) -> FloatArray:
    """Lengths along the trace at which the bead has a vertex: corners, knots, middles between.

    With the middles, no line's mixture is more than half a quantum from that at its end.
    """
    inner = np.empty(0)
    if len(knots) > 1:
        inner = np.sort(np.concatenate([knots, (knots[1:] + knots[:-1]) / 2]))
    all_mm = np.union1d(along, inner)
    all_mm = all_mm[np.append(True, np.diff(all_mm) > 1e-6)]
    points = at_lengths(trace.points, all_mm)
    share = np.interp(all_mm, along, trace.share_mm)
    tolerance_mm = _TOLERANCE * recipe.bead_mm
    scaled = share * tolerance_mm / (_SHARE_TOLERANCE * recipe.pitch_mm)
    fixed = np.clip(np.searchsorted(all_mm, inner - 1e-6), 0, len(all_mm) - 1)
    kept = simplified(np.column_stack([points, scaled]), tolerance_mm, fixed)
    return np.asarray(all_mm[kept])


def _at_pace(bead: Bead, pace: float) -> Bead:
    """The bead slower by a factor, with powder and beam; what it lays stays the same."""
    return replace(bead, speed_mm_s=bead.speed_mm_s * pace, power_W=bead.power_W * pace,
                   pace=bead.pace * pace)


def _within_reach(bead: Bead, recipe: Recipe, max_speed_mm_s: float) -> Bead:
    """The bead no faster than the axes: levelling asks for more than the recipe's speed.

    Where a hopper's least flow does not allow all of that, what is missing is laid too much.
    """
    pace = max_speed_mm_s / float(bead.speed_mm_s.max())
    if pace >= 1:
        return bead
    slower = _at_pace(bead, max(pace, _least_pace(bead, recipe)))
    return replace(slower, speed_mm_s=np.minimum(slower.speed_mm_s, max_speed_mm_s))


def _slowed(bead: Bead, recipe: Recipe) -> Bead:
    """The bead at the fastest pace at which the powder can follow its mixture.

    Slower, the mixture changes more slowly in time, and less flow is asked for: half the pace
    halves what the lag demands. Where no pace is slow enough, the one at which the powder is off
    for the least time. A jump takes the hoses the same time at any pace: it slows nothing.
    """
    least = _least_pace(bead, recipe)
    best, best_off_s = bead, np.inf
    for pace in PACES:
        if bead.pace * pace < least and pace != PACES[0]:
            break
        tried = _at_pace(bead, pace)
        off_s = _off_s(tried, recipe)
        if off_s == 0:
            return tried
        if off_s < _WORTH * best_off_s:
            best, best_off_s = tried, off_s
    return best


def _least_pace(bead: Bead, recipe: Recipe) -> float:
    """Below this pace a hopper would be asked for less than it can meter."""
    flow = recipe.flow_g_s(bead.fractions)
    metered = flow >= recipe.min_flow_g_s * (1 - 1e-9)
    ratio = np.where(metered & (flow > 0), recipe.min_flow_g_s / np.maximum(flow, 1e-12), 0.0)
    return float(ratio.max())


def _off_s(bead: Bead, recipe: Recipe) -> float:
    """For how long led powder lays another mixture than the bead's, after a settled start."""
    flow = recipe.flow_g_s(bead.fractions, bead.pace)
    lasting = np.linalg.norm(np.diff(bead.points, axis=0), axis=1) / bead.speed_mm_s
    times = np.concatenate([[0.0], np.cumsum(lasting)])
    laid_s, laid = followed(times, flow, flow[0], limits_of(recipe))
    wanted = np.column_stack([
        np.interp(laid_s, times, flow[:, m]) for m in range(flow.shape[1])])
    error = np.abs(recipe.laid_fractions(laid) - recipe.laid_fractions(wanted)).max(axis=1)
    return float(np.diff(laid_s)[error[1:] > TOLERANCE_FRACTION].sum())
