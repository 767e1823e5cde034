"""Turn ordered tracks into beads: vertices, mixtures that hoppers can meter, speed and power.

The volume per millimetre is strip width · layer height. Powder per second and beam power stay at
the recipe's values. Speed compensates the strip's difference from the nominal pitch, because speed
follows at once and powder only seconds later. So the energy per deposited volume is the recipe's
at every strip width. A bead that axes or powder cannot follow is slowed as a whole, with powder
and beam power in proportion, which keeps that energy too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.bead_vertices import bead_vertices
from lmctl.plan.sequence.composition_runs import (
    composition_knots,
    composition_runs,
    run_ends_mm,
)
from lmctl.plan.sequence.flat_arrays import greatest_differences, indices_within_stretches
from lmctl.plan.sequence.speed_factor import speed_factors
from lmctl.plan.sequence.track_order import OrderedTracks
from lmctl.plan.sequence.weak_flow import MeteredMixtures, metered_levels

#: Segments are made to last this part of what a line may: corners take time.
_FILL = 0.9


@dataclass(frozen=True)
class Beads:
    """The m beads of a layer in order, v vertices in all, in the part's own coordinates.

    points_mm : (v, 2) float64; fractions : (v, materials) float64, deposited there
    along_mm : (v,) float64, rising: place on the `OrderedTracks` they follow
    starts : (m + 1,) intp, bead k is vertices starts[k] to starts[k + 1]
    speed_mm_s, power_W : (v,) float64, from the vertex before; meaningless at a bead's first
    width_mm : (v,) float64, of the bead from the vertex before; its strip over 1 − overlap
    speed_factor : (m,) float64, of the recipe's speed, powder and power, for the whole bead
    rounded_mixture_mm : length whose mixture was moved to what the hoppers can meter
    rounded_by : by how much at most, volume fraction
    """

    points_mm: FloatArray
    fractions: FloatArray
    along_mm: FloatArray
    starts: IndexArray
    speed_mm_s: FloatArray
    power_W: FloatArray
    width_mm: FloatArray
    speed_factor: FloatArray
    rounded_mixture_mm: float
    rounded_by: float

    @property
    def count(self) -> int:
        return len(self.starts) - 1

    @property
    def first(self) -> IndexArray:
        """First vertex of each bead, (m,)."""
        return self.starts[:-1]

    @property
    def last(self) -> IndexArray:
        """Last vertex of each bead, (m,)."""
        return np.asarray(self.starts[1:] - 1)

    def bead_of_vertex(self) -> IndexArray:
        return np.repeat(np.arange(self.count), np.diff(self.starts))

    def lengths_mm(self) -> FloatArray:
        """From the vertex before to each vertex, (v,); 0 at a bead's first."""
        steps = np.zeros(len(self.points_mm))
        steps[1:] = np.sqrt((np.diff(self.points_mm, axis=0) ** 2).sum(axis=1))
        steps[self.first] = 0.0
        return steps


def make_beads(
    tracks: OrderedTracks, mixtures: MeteredMixtures, step: float, longest_s: float,
    max_speed_mm_s: float, where: str, *, leads: bool, uniform: bool = False,
    allowed: Callable[[FloatArray, str], FloatArray] | None = None,
) -> Beads:
    """The beads of a layer's tracks.

    mixtures : that hoppers can meter, by the recipe of the part
    step : quantum of volume fraction; longest_s : most a segment may last
    leads : whether powder is led, so that slowing down can help it follow
    uniform : one mixture a track, its mean (the strategy iso-3d)
    allowed : moves mixtures (r, m) that hoppers can meter out of forbidden regions
    Raises PlanError where no hopper can deliver what a bead needs.
    """
    recipe = mixtures.recipe
    fractions = _track_means(tracks) if uniform else tracks.fractions
    runs = composition_runs(fractions, tracks.starts, step)
    levels, faster = metered_levels(runs.levels, runs.track, tracks.n_tracks, mixtures, where)
    if allowed is not None:
        levels = allowed(levels, where)
    off = greatest_differences(levels, runs.levels)
    run_mm = np.diff(run_ends_mm(tracks.along_mm, tracks.starts, runs), axis=1)[:, 0]
    runs = replace(runs, levels=levels)
    knots_mm, knots, fixed_mm = composition_knots(
        tracks.along_mm, fractions, tracks.starts, runs, step)
    at, starts = bead_vertices(tracks, fixed_mm, recipe.bead_mm, recipe.pitch_mm)
    slowest = np.minimum.reduceat(
        recipe.speed(levels), np.searchsorted(runs.track, np.arange(tracks.n_tracks)))
    slowest *= np.minimum.reduceat(
        recipe.strip_speed_factor(tracks.strip_width_mm), tracks.starts[:-1])
    at, starts = _densified(at, starts, _FILL * longest_s * slowest)
    along, strips = tracks.along_mm, np.interp(at, tracks.along_mm, tracks.strip_width_mm)
    deposited = np.column_stack([np.interp(at, knots_mm, level) for level in knots.T])
    middle = _from_before(deposited)
    beads = Beads(
        points_mm=np.column_stack([np.interp(at, along, axis) for axis in tracks.points_mm.T]),
        fractions=deposited, along_mm=at, starts=starts,
        speed_mm_s=recipe.speed(middle) * recipe.strip_speed_factor(_from_before(strips)),
        power_W=recipe.power(middle),
        width_mm=_from_before(strips) * (recipe.bead_mm / recipe.pitch_mm),
        speed_factor=np.ones(tracks.n_tracks),
        rounded_mixture_mm=float(run_mm[off > step / 2].sum()),
        rounded_by=float(off[off > step / 2].max(initial=0.0)))
    if (faster > 1).any():
        beads = _scaled(beads, faster)
    beads = _within_axis_speed(beads, recipe, max_speed_mm_s)
    if not leads:
        return beads
    varies = np.bincount(runs.track, minlength=tracks.n_tracks) > 1
    if not varies.any():
        return beads
    return _scaled(beads, speed_factors(
        _durations_s(beads), recipe.flow_g_s(beads.fractions), beads.starts, beads.speed_factor,
        min_deliverable_speed_factors(beads, recipe), varies, recipe))


def _track_means(tracks: OrderedTracks) -> FloatArray:
    size = np.diff(tracks.starts)
    mean = np.add.reduceat(tracks.fractions, tracks.starts[:-1]) / size[:, None]
    return np.asarray(np.repeat(mean, size, axis=0))


def _from_before(values: FloatArray) -> FloatArray:
    """Middle of each value and the one before; the first stays."""
    middle = values.copy()
    middle[1:] = (values[1:] + values[:-1]) / 2
    return middle


def _densified(
    at_mm: FloatArray, starts: IndexArray, spacing_mm: FloatArray
) -> tuple[FloatArray, IndexArray]:
    """Lengths with others between where two of a track are more than its spacing (m,) apart."""
    track = np.repeat(np.arange(len(spacing_mm)), np.diff(starts))
    pieces = np.maximum(1, np.ceil(np.diff(at_mm) / spacing_mm[track[1:]])).astype(np.intp)
    pieces[starts[1:-1] - 1] = 1  # from one track to the next
    if pieces.max(initial=1) == 1:
        return at_mm, starts
    index = np.repeat(np.arange(len(pieces)), pieces)
    share = indices_within_stretches(pieces) / pieces[index]
    dense = at_mm[index] + share * (at_mm[index + 1] - at_mm[index])
    moved = np.concatenate([[0], np.cumsum(pieces)])
    new_starts = np.append(moved[starts[:-1]], len(dense) + 1)
    return np.append(dense, at_mm[-1]), new_starts


def _durations_s(beads: Beads) -> FloatArray:
    return np.asarray(beads.lengths_mm() / beads.speed_mm_s)


def _scaled(beads: Beads, factor: FloatArray) -> Beads:
    """Beads slower by factors (m,), with powder and beam; what they deposit stays the same."""
    each = np.repeat(factor, np.diff(beads.starts))
    return replace(beads, speed_mm_s=beads.speed_mm_s * each, power_W=beads.power_W * each,
                   speed_factor=beads.speed_factor * factor)


def _within_axis_speed(beads: Beads, recipe: Recipe, max_speed_mm_s: float) -> Beads:
    """Beads no faster than the axes: narrow strips need more than the recipe's speed.

    Where a hopper's least flow limits the slowing, the bead gets that much too much powder.
    """
    fastest = beads.speed_mm_s.copy()
    fastest[beads.first] = 0.0
    factor = max_speed_mm_s / np.maximum.reduceat(fastest, beads.first)
    if (factor >= 1).all():
        return beads
    least = min_deliverable_speed_factors(beads, recipe)
    slower = _scaled(beads, np.where(factor < 1, np.maximum(factor, least), 1.0))
    return replace(slower, speed_mm_s=np.minimum(slower.speed_mm_s, max_speed_mm_s))


def min_deliverable_speed_factors(beads: Beads, recipe: Recipe) -> FloatArray:
    """Speed factors (m,) below which a hopper would have to meter less than it can."""
    flow = recipe.flow_g_s(beads.fractions)
    metered = (flow >= recipe.min_flow_g_s * (1 - 1e-9)) & (flow > 0)
    ratio = np.where(metered, recipe.min_flow_g_s / np.maximum(flow, 1e-12), 0.0).max(axis=1)
    return np.asarray(np.maximum.reduceat(ratio, beads.first))
