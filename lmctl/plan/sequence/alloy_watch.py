"""Keep forbidden mixtures out of what a layer is predicted to deposit.

A layer is sequenced, and each place looked at where the nozzle would come nearer to a region than
half the rule's margin although no such mixture is planned there: powder comes late. A path that
begins so gets more time before it; elsewhere the path is cut, so that powder arrives with the beam
off. Where half the margin cannot be kept, the region itself is: what the whole program is predicted
to deposit, with set-points as feeders get them, is looked at again, and refused if it lies inside.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.errors import PlanError
from lmctl.part.materials.laid_mixtures import LaidMixtures, nearest_listed_mixtures
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.sequence.alloy_cuts import (
    cut_at_crossings,
    cut_between_vertices,
    cut_ordered_tracks,
)
from lmctl.plan.sequence.alloy_statistics import AlloyStatistics
from lmctl.plan.sequence.bead_pieces import BeadPieces
from lmctl.plan.sequence.composition_runs import composition_runs
from lmctl.plan.sequence.mixture_prediction import MixturePrediction
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow
from lmctl.plan.sequence.track_order import OrderedTracks
from lmctl.plan.sequence.weak_flow import MeteredMixtures, metered_levels

#: A path's first length, in which late powder is given more time before the path, in beads.
_BEGINNING_BEADS = 0.5
#: Each time more, in lags of the slowest hopper.
_WAIT_LAGS = 2.0
#: How often tracks are cut where metered mixtures lie across a region.
_LEVEL_ROUNDS = 4
#: Changes of mixture smaller than this cross nothing.
_NO_CHANGE = 1e-6


class AlloyWatch:
    """Looks at what layers are predicted to deposit, under the alloy rules of a part.

    statistics : what the rules changed in the layers so far
    """

    def __init__(self, mixtures: LaidMixtures, metered: MeteredMixtures, step: float) -> None:
        """step : quantum of volume fraction along a path"""
        self.statistics = AlloyStatistics(mixtures)
        self._mixtures = mixtures
        self._metered = metered
        self._step = step
        recipe = self._recipe = metered.recipe
        flow = recipe.flow_g_s(mixtures.grid)
        meters = (flow <= 0) | (flow >= recipe.min_flow_g_s * (1 - 1e-9))
        self._deliverable = mixtures.grid[
            (meters & (flow <= recipe.max_flow_g_s * (1 + 1e-9))).all(axis=1)]

    def cut(self, geometry: LayerGeometry) -> LayerGeometry:
        """A layer with its tracks cut where their mixture crosses a region."""
        cut = cut_at_crossings(geometry, self._mixtures, self._recipe.bead_mm)
        self.statistics.add_cuts(cut.cuts, cut.joined_mm)
        return cut.geometry

    def cut_between_levels(self, tracks: OrderedTracks, where: str) -> OrderedTracks:
        """Tracks cut where the mixtures that hoppers can meter lie across a region from each other,
        though the part's do not: a powder that is too scarce is rounded to none or to the least.

        Not where dilution is made up for: what is fed is no alloy. Raises PlanError as
        `metered_levels`
        """
        for _ in range(_LEVEL_ROUNDS if tracks.melted is None else 0):
            runs = composition_runs(tracks.fractions, tracks.starts, self._step)
            levels, _ = metered_levels(
                runs.levels, runs.track, tracks.n_tracks, self._metered, where)
            levels = self.allowed_levels(levels, where)
            edge = np.flatnonzero(runs.track[1:] == runs.track[:-1])
            edge = edge[self._mixtures.crosses_region(levels[edge], levels[edge + 1])]
            if len(edge) == 0:
                break
            self.statistics.add_cuts(len(edge), 0.0)
            tracks = cut_between_vertices(tracks, runs.bounds[edge + 1])
        return tracks

    def allowed_levels(self, levels: FloatArray, where: str) -> FloatArray:
        """Mixtures (r, m) that hoppers can meter, with forbidden ones moved to the nearest that
        hoppers can meter too. Raises PlanError where there is none."""
        rules = self._mixtures.rules
        rule = rules.regions.rule_at(levels, self._mixtures.near_region)
        bad = np.flatnonzero(rule >= 0)
        if len(bad) == 0:
            return levels
        if len(self._deliverable) == 0:
            raise PlanError(
                "alloy rules leave no mixture that the hoppers can meter", where=(
                    where, rules.rules[rule[bad[0]]].as_text()),
                hint="raise speed_mm_s, or take hoppers that meter less")
        result = levels.copy()
        result[bad] = nearest_listed_mixtures(levels[bad], self._deliverable)
        return result

    def mended(
        self, tracks: OrderedTracks, wait_s: FloatArray, pieces: BeadPieces, moves: Moves,
        end_s: FloatArray, flow: PowderFlow,
    ) -> tuple[OrderedTracks, FloatArray] | None:
        """Tracks and waits that keep forbidden mixtures out; None where powder is late nowhere.

        wait_s : (m,) time that powder gets before each track beside what it needs [s]
        pieces : of the layer's beads; end_s : (n,) of `moves`
        flow : at the nozzle, which led set-points deliver
        """
        line = np.searchsorted(end_s, pieces.at_s)
        path = moves.path[line].astype(np.int64)
        share = 1 - (end_s[line] - pieces.at_s) / np.maximum(
            end_s[line] - np.concatenate([[0.0], end_s])[line], 1e-12)
        along_mm = moves.along_mm[line, 0] + share * np.diff(moves.along_mm[line], axis=1)[:, 0]
        at_nozzle = np.column_stack([
            np.interp(pieces.at_s, flow.times_s, column) for column in flow.g_s.T])
        laid = pieces.laid(self._recipe.deposited_fractions(at_nozzle))
        late = np.zeros(len(line), np.bool_)
        for bounds in (self._mixtures.rules.regions.bounds, self._mixtures.near_region):
            late |= self._forbidden(laid, path, bounds) & ~self._forbidden(
                pieces.planned, path, bounds)
        if not late.any():
            return None
        wait_s = wait_s.copy()
        begin_mm = tracks.along_mm[tracks.starts[:-1]]
        near_mm = _BEGINNING_BEADS * self._recipe.bead_mm
        cuts = []
        for number in np.unique(path[late]).tolist():
            at = along_mm[late & (path == number)].min()
            if at - begin_mm[number] <= near_mm:
                wait_s[number] += _WAIT_LAGS * float(self._recipe.lag_s.max()) + 0.1
            else:
                cuts.append((number, at - near_mm / 2))
        if not cuts:
            return tracks, wait_s
        settled_s = 2 * _WAIT_LAGS * float(self._recipe.lag_s.max()) + 0.1
        self.statistics.add_cuts(len(cuts), 0.0)
        return (cut_ordered_tracks(tracks, np.array([at for _, at in cuts])),
                np.insert(wait_s, np.array([number for number, _ in cuts]) + 1, settled_s))

    def check(self, deposit: MixturePrediction) -> None:
        """Look at what a layer is predicted to deposit. Raises PlanError where it is forbidden."""
        pieces, rules = deposit.pieces, self._mixtures.rules
        m = rules.regions.n_powders
        rule = rules.regions.rule_at(deposit.predicted[:, :m])
        inside = rule >= 0
        if not inside.any():
            self.statistics.add_deposit(pieces)
            return
        at = int(np.argmax(inside))
        planned = rules.regions.rule_at(pieces.planned[:, :m])[inside] >= 0
        where = [f"layer {pieces.layer + 1}: {float(pieces.length_mm[inside].sum()):.3g} mm, first "
                 f"{rules.mixture_text(deposit.predicted[at, :m])}",
                 rules.rules[int(rule[at])].as_text()]
        if pieces.melted is not None and planned.any():
            where.insert(1, "of it is melted from the layer below, or from the substrate")
            hint = ('an impossible pair: lead the blend round it (way = "around"), or put another '
                    "material between the two")
        elif planned.any():
            hint = "raise speed_mm_s, so that hoppers meter what lies beside the region"
        else:
            hint = ('powder comes late: plan with powder = "lead", lower speed_mm_s, or raise the '
                    "rule's margin")
        raise PlanError("a forbidden mixture would be deposited", where=where, hint=hint)

    def _forbidden(self, mixtures: FloatArray, path: IntArray, bounds: FloatArray) -> BoolArray:
        """Which places (q,) have a mixture inside regions of these bounds, or across one from the
        place before. A foreign substrate is none of the rules' powders."""
        regions = self._mixtures.rules.regions
        mixtures = mixtures[:, : regions.n_powders]
        found = regions.rule_at(mixtures, bounds) >= 0
        change = np.abs(np.diff(mixtures, axis=0)).max(axis=1) > _NO_CHANGE
        step = np.flatnonzero(change & (path[1:] == path[:-1]))
        crossed = ~np.isnan(regions.crossings(mixtures[step], mixtures[step + 1], bounds)[:, 0])
        found[step[crossed] + 1] = True
        return np.asarray(found)
