"""The mixture that is laid where the part has one that alloy rules forbid.

A blend between two mixtures that the part file names is a straight line of mixtures. Where it
crosses a region, what lies inside is either made of the mixtures on the nearer of its two edges,
so that the mixture jumps there, or laid along the shortest way round, even in length. Mixtures of
several blends at once lie on no such line: they become the nearest allowed mixture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.part.materials.allowed_mixtures import AllowedMixtures
from lmctl.part.materials.alloy_rules import AlloyRules
from lmctl.part.materials.composition import CompositionField
from lmctl.part.materials.forbidden_regions import NO_FRACTION
from lmctl.part.materials.ways_round import shortest_way, simplex_grid

#: What is deposited differs from the wanted mixture by up to so many quanta (composition_runs).
_ROUNDING_QUANTA = 1.1
#: Mixtures this near to a line between two others lie on it.
_ON_LINE = 1e-6
#: Nearest mixtures are sought on a grid of at most so many steps, by powders.
_MOST_STEPS = {1: 1, 2: 1000, 3: 100, 4: 50}


@dataclass(frozen=True, eq=False)
class BlendCrossing:
    """A blend from one named mixture to another, across a region.

    begin, end : (m,) named mixtures; span : shares of the blend that are not allowed
    rules : numbers of the rules that forbid them
    edges : allowed mixtures at both ends of the span, (m,) each; None where the blend begins or
        ends inside
    way : (k, m) the way round, or None for a jump
    """

    begin: FloatArray
    end: FloatArray
    span: tuple[float, float]
    rules: tuple[int, ...]
    edges: tuple[FloatArray | None, FloatArray | None]
    way: FloatArray | None

    def share_of(self, fractions: FloatArray) -> FloatArray:
        """Place along the blend of each mixture (n, m) on it; NaN of those beside it."""
        along = self.end - self.begin
        share = (fractions - self.begin) @ along / (along @ along)
        off = np.abs(fractions - self.begin - share[:, None] * along).max(axis=1)
        return np.where((off <= _ON_LINE) & (share >= -_ON_LINE) & (share <= 1 + _ON_LINE),
                        share, np.nan)

    def laid(self, share: FloatArray) -> FloatArray:
        """What is laid at places (n,) within the span: (n, m)."""
        low, high = self.span
        if self.way is not None:
            step = np.linalg.norm(np.diff(self.way, axis=0), axis=1)
            length = np.concatenate([[0.0], np.cumsum(step)])
            at = np.clip((share - low) / (high - low), 0, 1) * length[-1]
            return np.column_stack([np.interp(at, length, column) for column in self.way.T])
        first, last = self.edges
        if first is None or last is None:
            only = first if last is None else last
            assert only is not None, "one edge is left, or the blend is no crossing"
            return np.tile(only, (len(share), 1))
        return np.where((share <= (low + high) / 2)[:, None], first, last)


class LaidMixtures:
    """What a plan lays where the part's own mixtures are forbidden.

    step : quantum of volume fraction along a path
    """

    def __init__(self, rules: AlloyRules, step: float) -> None:
        self.rules = rules
        self._step = step
        self.allowed = AllowedMixtures(rules, _ROUNDING_QUANTA * step)
        self._at_margin = AllowedMixtures(rules, 0.0)
        self.near_region = rules.regions.grown_bounds(rules.margins / 2)

    @cached_property
    def crossings(self) -> tuple[BlendCrossing, ...]:
        """Of all blends between two named mixtures, the longest first."""
        found = [self._crossing(one, other, (low, high), rules)
                 for one, other in self.rules.blends()
                 for low, high, rules in self.allowed.spans(one, other)]
        return tuple(crossing for crossing in found if crossing is not None)

    def laid(self, fractions: FloatArray) -> tuple[FloatArray, IntArray]:
        """What is laid where the part has mixtures (n, m), and the rule that changed each; −1
        where it is laid as it is."""
        result = np.array(fractions, dtype=np.float64)
        result[result < NO_FRACTION] = 0.0
        rule = self.allowed.rule_at(result)
        todo = np.flatnonzero(rule >= 0)
        for crossing in self.crossings:
            if len(todo) == 0:
                break
            share = crossing.share_of(result[todo])
            low, high = crossing.span
            on = (share >= low - _ON_LINE) & (share <= high + _ON_LINE)
            result[todo[on]] = crossing.laid(share[on])
            todo = todo[~on]
        if len(todo) and len(self.grid):
            result[todo] = nearest_listed_mixtures(result[todo], self.grid)
        return result, rule

    def nearest_allowed(self, mixture: FloatArray) -> FloatArray | None:
        """The nearest mixture (m,) that may be laid; None where there is none."""
        if self._at_margin.rule_at(mixture[None])[0] < 0:
            return mixture
        return nearest_listed_mixtures(mixture[None], self.grid)[0] if len(self.grid) else None

    def crosses_region(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether straight changes between laid mixtures (n, m) come nearer to a region than half
        its margin, (n,)."""
        found = self.rules.regions.crossings(begin, end, self.near_region)
        return np.asarray(~np.isnan(found[:, 0]))

    @cached_property
    def grid(self) -> FloatArray:
        """Mixtures in whole quanta that keep their margins, (g, m); they are laid as they are."""
        m = self.rules.regions.n_powders
        steps = min(max(1, round(1 / self._step)), _MOST_STEPS[m])
        grid = simplex_grid(steps, m) / steps
        return np.asarray(grid[self._at_margin.rule_at(grid) < 0])

    def _crossing(
        self, begin: FloatArray, end: FloatArray, span: tuple[float, float],
        rules: tuple[int, ...],
    ) -> BlendCrossing | None:
        """One blend across a region; None where neither end of it is allowed."""
        beside = _ON_LINE / float(np.linalg.norm(end - begin))
        span = (max(span[0] - beside, 0.0), min(span[1] + beside, 1.0))
        places = [begin + share * (end - begin) for share in span]
        edges = []
        for place, share, own in zip(places, span, (begin, end), strict=True):
            at_end = share <= _ON_LINE or share >= 1 - _ON_LINE
            place = own if at_end else np.where(place < NO_FRACTION, 0.0, place)
            kept = self._at_margin if at_end else self.allowed
            edges.append(place if not at_end or kept.rule_at(place[None])[0] < 0 else None)
        first, last = edges
        if first is None and last is None:
            return None
        return BlendCrossing(begin, end, span, rules, (first, last),
                             self._way(first, last, rules))

    def _way(
        self, first: FloatArray | None, last: FloatArray | None, rules: tuple[int, ...]
    ) -> FloatArray | None:
        own = [self.rules.rules[number] for number in rules]
        if first is None or last is None or any(rule.way == "jump" for rule in own):
            return None
        powders = np.all([rule.through for rule in own], axis=0)
        return shortest_way(first, last, self.allowed, powders)


def nearest_listed_mixtures(fractions: FloatArray, listed: FloatArray) -> FloatArray:
    """The nearest of listed mixtures (g, m) to each of others (n, m), by the greatest difference
    of a fraction; one without further powders where there is one."""
    from scipy.spatial import cKDTree  # late: few parts have rules

    found = np.empty_like(fractions)
    bits = 1 << np.arange(fractions.shape[1])
    fed, own = (listed > NO_FRACTION) @ bits, (fractions > NO_FRACTION) @ bits
    for powders in np.unique(own).tolist():
        without_more = (fed & ~powders) == 0
        choice = listed[without_more] if without_more.any() else listed
        rows = np.flatnonzero(own == powders)
        _, nearest = cKDTree(choice).query(fractions[rows], p=np.inf)
        found[rows] = choice[nearest]
    return found


@dataclass(frozen=True, eq=False)
class RuledComposition:
    """What is laid of a composition field, under alloy rules."""

    designed: CompositionField
    mixtures: LaidMixtures

    def fractions(self, points: FloatArray) -> FloatArray:
        return self.mixtures.laid(self.designed.fractions(points))[0]
