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

from lmctl.array_types import BoolArray, FloatArray, IndexArray
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION

#: Factors on the recipe's speed that are tried, the least that is enough is taken.
_FACTORS = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5)
#: Rounding by more than this is worth another speed: half the tolerance of a mixture, as steps of
#: mixture take up to the other half.
_WORTH_FRACTION = MIXTURE_TOLERANCE_FRACTION / 2


class MeteredMixtures:
    """What hoppers can meter of the mixtures that a part wants, found once for all its layers.

    recipe : at factor 1; fastest : greatest factor on its speed that beam power allows
    """

    def __init__(self, recipe: Recipe, fastest: float) -> None:
        self.recipe = recipe
        self._fastest = fastest
        self._number: dict[bytes, int] = {}
        materials = len(recipe.hoppers)
        self._at_recipe_speed = np.empty((0, materials))
        self._alone = np.empty((0, materials))
        self._factor = np.empty(0)

    def metered(
        self, wanted: FloatArray, alone: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """The nearest mixtures that hoppers can meter, and the factors on the recipe's speed.

        wanted : (r, materials), few different ones; alone : (r,) the only mixture of its track,
            which may be deposited faster
        returns : (r, materials), (r,) from 1
        """
        different, which = _different_rows(wanted)
        keys = [row.tobytes() for row in different]
        new = [k for k, key in enumerate(keys) if key not in self._number]
        if new:
            self._add(different[new], [keys[k] for k in new])
        number = np.array([self._number[key] for key in keys], dtype=np.intp)[which]
        return (np.where(alone[:, None], self._alone[number], self._at_recipe_speed[number]),
                np.where(alone, self._factor[number], 1.0))

    def _add(self, wanted: FloatArray, keys: list[bytes]) -> None:
        """Mixtures (k, materials) not known yet: each of the factors as long as it is worth it."""
        best = self.recipe.deliverable_mixtures(wanted)
        plain, factor = best.copy(), np.ones(len(wanted))
        off = np.abs(best - wanted).max(axis=1)
        for tried in _FACTORS[1:]:
            rows = np.flatnonzero(off > _WORTH_FRACTION)
            if len(rows) == 0 or tried > self._fastest:
                break
            at_speed = _at_speed(self.recipe, tried)
            found = at_speed.deliverable_mixtures(wanted[rows])
            now = np.abs(found - wanted[rows]).max(axis=1)
            enough = (at_speed.flow_g_s(found) <= at_speed.max_flow_g_s).all(axis=1)
            better = enough & (now < off[rows] - 1e-9)
            rows = rows[better]
            best[rows], factor[rows], off[rows] = found[better], tried, now[better]
        self._number.update({key: len(self._factor) + k for k, key in enumerate(keys)})
        self._at_recipe_speed = np.vstack([self._at_recipe_speed, plain])
        self._alone = np.vstack([self._alone, best])
        self._factor = np.append(self._factor, factor)


def metered_levels(
    levels: FloatArray, track: IndexArray, n_tracks: int, mixtures: MeteredMixtures, where: str
) -> tuple[FloatArray, FloatArray]:
    """Mixtures that hoppers can meter, and how much faster than the recipe each track is deposited.

    levels : (r, materials) wanted in the runs of a layer; track : (r,) the track of each, rising
    returns : (r, materials), and (n_tracks,) factors from 1
    Raises PlanError where no hopper can deliver what a track needs.
    """
    alone = (np.bincount(track, minlength=n_tracks) == 1)[track]
    best, by_run = mixtures.metered(levels, alone)
    factor = np.ones(n_tracks)
    factor[track[alone]] = by_run[alone]
    for tried in np.unique(by_run).tolist():
        _at_speed(mixtures.recipe, tried).check_deliverable(best[by_run == tried], where)
    return best, factor


def _different_rows(rows: FloatArray) -> tuple[FloatArray, IndexArray]:
    """The rows without repetitions, and which of them each row is; column by column, as sorting
    numbers is faster than sorting rows."""
    number = np.zeros(len(rows), dtype=np.intp)
    for column in rows.T:
        values, at = np.unique(column, return_inverse=True)
        if len(values) > 1:
            number = np.unique(number * len(values) + at, return_inverse=True)[1]
    _, first = np.unique(number, return_index=True)
    return rows[first], number


def _at_speed(recipe: Recipe, factor: float) -> Recipe:
    """The recipe with the hoppers' limits as they are for flows at the recipe's own speed."""
    if factor == 1.0:
        return recipe
    return replace(recipe, min_flow_g_s=recipe.min_flow_g_s / factor,
                   max_flow_g_s=recipe.max_flow_g_s / factor)
