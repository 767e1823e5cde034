"""Tracks whose mixture wants less of a powder than its hopper meters: faster, or rounded.

A bead deposited faster by a factor, with beam power and powder in proportion, is the same bead:
energy and powder per length stay. Its hoppers all run faster, so that a powder too scarce for its
hopper at the recipe's speed may be metered. Only tracks of one mixture are deposited so: along
others powder would have to change faster, too. What is too scarce even so is set to none or to the
least, whichever is nearer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION

#: Factors on the recipe's speed that are tried, the least that is enough is taken.
_FACTORS = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5)
#: Rounding by more than this is worth another speed: half the tolerance of a mixture, as steps of
#: mixture take up to the other half.
_WORTH_FRACTION = MIXTURE_TOLERANCE_FRACTION / 2


def metered_levels(
    levels: FloatArray, track: IndexArray, n_tracks: int, recipe: Recipe, fastest: float, where: str
) -> tuple[FloatArray, FloatArray]:
    """Mixtures that hoppers can meter, and how much faster than the recipe each track is deposited.

    levels : (r, materials) wanted in the runs of a layer; track : (r,) the track of each, rising
    fastest : greatest factor that beam power allows
    returns : (r, materials), and (n_tracks,) factors from 1
    Raises PlanError where no hopper can deliver what a track needs.
    """
    best = recipe.deliverable_mixtures(levels)
    factor = np.ones(n_tracks)
    steady = np.bincount(track, minlength=n_tracks) == 1
    off = np.where(steady, _worst(best, levels, track), 0.0)
    for tried in _FACTORS[1:]:
        open_ = off > _WORTH_FRACTION
        if not open_.any() or tried > fastest:
            break
        rows = np.flatnonzero(open_[track])
        at_speed = _at_speed(recipe, tried)
        found = at_speed.deliverable_mixtures(levels[rows])
        enough = (at_speed.flow_g_s(found) <= at_speed.max_flow_g_s).all(axis=1)
        fits = np.ones(n_tracks, dtype=np.bool_)
        np.logical_and.at(fits, track[rows], enough)
        new = best.copy()
        new[rows] = found
        now = np.where(steady, _worst(new, levels, track), 0.0)
        better = open_ & fits & (now < off - 1e-9)
        best = np.where(better[track][:, None], new, best)
        factor[better], off = tried, np.where(better, now, off)
    for tried in np.unique(factor).tolist():
        _at_speed(recipe, tried).check_deliverable(best[factor[track] == tried], where)
    return best, factor


def _at_speed(recipe: Recipe, factor: float) -> Recipe:
    """The recipe with the hoppers' limits as they are for flows at the recipe's own speed."""
    if factor == 1.0:
        return recipe
    return replace(recipe, min_flow_g_s=recipe.min_flow_g_s / factor,
                   max_flow_g_s=recipe.max_flow_g_s / factor)


def _worst(levels: FloatArray, wanted: FloatArray, track: IndexArray) -> FloatArray:
    """Greatest difference on each track, (n_tracks,)."""
    first = np.flatnonzero(np.append(True, track[1:] != track[:-1]))
    return np.asarray(np.maximum.reduceat(np.abs(levels - wanted).max(axis=1), first))
