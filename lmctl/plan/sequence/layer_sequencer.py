"""The sequence stage: layers in order, each from its geometry to timed lines and powder flow.

This stage carries the only state that planning has: the nozzle position, the mixture and
flow, at what program time, and how lines and paths are numbered. Every step works on all of a
layer's arrays at once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import ProcessSettings
from lmctl.part.substrate import LayerStack
from lmctl.plan.dilution import DilutionCompensation, DilutionStatistics
from lmctl.plan.dilution.fitted_mixtures import fitted_mixtures, laid_columns
from lmctl.plan.dilution.poured_columns import LaidColumns
from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.plan_statistics import PlanStatistics
from lmctl.plan.program_text.layer_text import LayerLines
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.bead_pieces import bead_pieces, designed_at_line_ends
from lmctl.plan.sequence.beads import Beads, make_beads
from lmctl.plan.sequence.draping import LayerDrape
from lmctl.plan.sequence.heat_order import OrderAttempt, Rearrangement, quickest_attempt
from lmctl.plan.sequence.interrupted_beads import waits_of_pieces
from lmctl.plan.sequence.layer_motion import LayerMotion, LayerSite
from lmctl.plan.sequence.layer_waits import LayerWaits, first_bead_s
from lmctl.plan.sequence.line_timing import bead_line_ranges
from lmctl.plan.sequence.mixture_cuts import cut_tracks
from lmctl.plan.sequence.mixture_prediction import MixturePrediction, PathPredictor
from lmctl.plan.sequence.mixture_ramps import (
    min_ramp_duration_s,
    powder_limits_of,
)
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow, powder_flow
from lmctl.plan.sequence.powder_pause import powder_pause_of
from lmctl.plan.sequence.sampled_layers import SampledLayers
from lmctl.plan.sequence.sequence_state import SequenceState
from lmctl.plan.sequence.track_order import OrderedTracks, order_tracks
from lmctl.plan.sequence.weak_flow import MeteredMixtures
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.materials.laid_mixtures import LaidMixtures
    from lmctl.plan.heat import HeatPlanner
    from lmctl.plan.sequence.alloy_statistics import AlloyStatistics
    from lmctl.plan.sequence.alloy_watch import AlloyWatch


class LayerSequencer:
    """Sequences the layers of one part in order; the statistics sum up those done so far, and
    `samples` keeps what is predicted of some of them.

    dilution : compensates for it; None: beads are taken to be of what is fed
    stack : how the layers of a flattened part lie (`part.substrate`); None: level
    mixtures : what alloy rules leave, where the part has rules
    heat : predicts temperature and chooses waits; None: nothing is predicted
    """

    def __init__(
        self, part_name: str, process: ProcessSettings, recipe: Recipe, profile: MachineProfile,
        dilution: DilutionCompensation | None = None, stack: LayerStack | None = None,
        mixtures: LaidMixtures | None = None, heat: HeatPlanner | None = None,
    ) -> None:
        self._dilution = dilution
        self._laid: LaidColumns | None = None
        self._stack = stack
        self._process = process
        self._profile = profile
        self._recipe = recipe
        self._mixtures = MeteredMixtures(
            recipe, profile.laser.max_power_W / float(recipe.power_W.max())
            / max(process.first_layer_power, 1.0))
        self._limits = powder_limits_of(recipe)
        self._pause = powder_pause_of(recipe, profile)
        self._leads = process.powder == "lead"
        self._predictor = PathPredictor(recipe, leads=self._leads)
        self._motion = LayerMotion(part_name, process, recipe, profile)
        self._heat = heat
        self._waits = LayerWaits(
            process.least_layer_time_s, heat, profile.motion, self._motion.purge)
        self._state = SequenceState(self._motion.purge.place_mm)
        self.statistics = PlanStatistics(recipe, has_alloy_rules=mixtures is not None)
        self.dilution_statistics = DilutionStatistics(
            (*(material.name for material in recipe.materials), "substrate"))
        self.samples = SampledLayers()
        self._watch: AlloyWatch | None = None
        if mixtures is not None:
            from lmctl.plan.sequence.alloy_watch import AlloyWatch  # late: most parts have no rules

            self._watch = AlloyWatch(mixtures, self._mixtures, process.fraction_step)

    @property
    def alloy_statistics(self) -> AlloyStatistics | None:
        """What alloy rules changed so far; None where there are no rules."""
        return None if self._watch is None else self._watch.statistics

    @property
    def duration_s(self) -> float:
        """Program time at the end of what is sequenced so far."""
        return self._state.time_s

    def sequence(
        self, index: int, geometry: LayerGeometry, placement: Placement, *, is_last: bool,
        clears_all: bool = False,
    ) -> LayerLines:
        """Sequence the next layer of the job, the first of which must have tracks.

        index : in the job, from 0; is_last : whether the program ends with it
        clears_all : whether the way to it leads across what the layers before have built
        placement : without the layers below the part's first with tracks. Which layer of it this
            is decides its height, the turn of its seam and its direction, so that layers planned
            alone look as they do among all
        Raises PlanError: a flow no hopper can deliver, motion outside the machine's travel, a
        power that S words cannot express.
        """
        number = geometry.layer - placement.skipped
        if self._watch is not None and geometry.n_tracks:
            geometry = self._watch.cut(geometry)
        geometry = self._compensated(geometry, number)
        if self._leads and self._process.strategy != "iso-3d":
            cut = cut_tracks(geometry, self._recipe)
            geometry = cut.geometry
            self.statistics.add_cuts(cut.cuts, cut.too_short)
        tracks = self._ordered(geometry, number, placement)
        drape = self._drape(number, placement)
        site = LayerSite(
            number, placement, drape,
            self._state.at_mm[2] + self._motion.clearance_mm if clears_all else None,
            self._power_factor(number, tracks, placement))
        wait_s = None
        if self._watch is not None and tracks.n_tracks:
            tracks, wait_s = self._under_alloy_rules(site, tracks, self._watch, is_last=is_last)
        chosen = self._with_heat_waits(index, site, geometry, tracks, wait_s, is_last=is_last)
        tracks, beads = chosen.tracks, chosen.beads
        self.statistics.add_beads(number, geometry, beads)
        nozzle_mm = placement.nozzle_height_mm(number) if drape is None else drape.highest_mm()
        moves, durations = self._motion.timed_moves(
            site, self._state, beads, chosen.wait_s, chosen.heat_wait_s, is_last=is_last)
        state = self._state
        if self._heat is not None:
            self._heat.add_layer(index, moves, state.at_mm, durations, site.power_factor)
        end_s = state.time_s + np.cumsum(durations)
        flow = self._flow(moves, beads, end_s)
        self.statistics.add_program(moves, durations, state.time_s, end_s, flow)
        pieces = None if beads is None else bead_pieces(
            index, geometry.z_mm, tracks, moves, state.at_mm, state.time_s, end_s,
            placement.offset_mm)
        self._add_predictions(self._predictor.add_layer(pieces, flow))
        if beads is not None and not is_last:
            self._laid = laid_columns(beads, tracks, self._recipe, self._laid)
        if is_last:
            self.finish()
        layer = LayerLines(
            index=index, z_mm=nozzle_mm, first_line=state.line,
            first_path=state.path, moves=moves, end_s=end_s, flow=flow,
            designed=None if beads is None else designed_at_line_ends(tracks, moves),
            laser_settings=self._profile.laser, opens=index == 0, closes=is_last)
        self._state = SequenceState(
            at_mm=moves.target_mm[-1], time_s=float(end_s[-1]), line=state.line + len(moves),
            path=state.path + (0 if beads is None else beads.count),
            mixture=state.mixture if beads is None else beads.fractions[-1],
            flow_g_s=flow.g_s[-1],
            first_bead_s=state.first_bead_s if beads is None else first_bead_s(moves, end_s))
        return layer

    def _ordered(
        self, geometry: LayerGeometry, number: int, placement: Placement,
        rearranged: Rearrangement | None = None,
    ) -> OrderedTracks:
        """The layer's tracks in order of deposition."""
        tracks = order_tracks(
            geometry, number, self._state.at_mm[:2] - placement.offset_mm[:2], self._state.mixture,
            self._process.fraction_step, self._change_s, self._process.seam, rearranged)
        return tracks if self._dilution is None else fitted_mixtures(
            tracks, self._recipe, self._laid)

    def _with_heat_waits(
        self, index: int, site: LayerSite, geometry: LayerGeometry, tracks: OrderedTracks,
        wait_s: FloatArray | None, *, is_last: bool,
    ) -> OrderAttempt:
        """Tracks in the order that takes least time, their beads, and the times before them."""
        heat = self._heat
        first = self._attempt(index, site, tracks, wait_s, is_last=is_last)
        if heat is None or self._watch is not None or first.beads is None:
            return first
        return quickest_attempt(
            heat, geometry, site.placement.offset_mm, first,
            lambda rearranged: self._ordered(geometry, site.number, site.placement, rearranged),
            lambda other: self._attempt(index, site, other, None, is_last=is_last))

    def _attempt(
        self, index: int, site: LayerSite, tracks: OrderedTracks, wait_s: FloatArray | None, *,
        is_last: bool,
    ) -> OrderAttempt:
        """The beads of tracks in one order, interrupted where heat needs it."""
        state, whole = self._state, self._beads(site, tracks)
        if whole is None:
            return OrderAttempt(tracks, None, wait_s, None, 0.0)
        beads, heat_wait_s = self._waits.choose(
            index, whole,
            lambda pieces: self._motion.moves(
                site, state, pieces, waits_of_pieces(wait_s, whole, pieces), is_last=is_last),
            state.at_mm, None if state.first_bead_s is None else state.time_s - state.first_bead_s)
        wait_s = waits_of_pieces(wait_s, whole, beads)
        lasting_s = 0.0
        if self._heat is not None and self._heat.choice.is_compared:
            lasting_s = float(self._motion.timed_moves(
                site, state, beads, wait_s, heat_wait_s, is_last=is_last)[1].sum())
        return OrderAttempt(tracks, beads, wait_s, heat_wait_s, lasting_s)

    def _compensated(self, geometry: LayerGeometry, number: int) -> LayerGeometry:
        """The layer with the mixtures to feed, which make up for dilution where it is known."""
        if self._dilution is None or geometry.n_tracks == 0:
            return geometry
        layer = self._dilution.compensated(geometry, number)
        self.dilution_statistics.add_layer(number, geometry, layer)
        return geometry if layer is None else layer.geometry

    def finish(self) -> None:
        """No layer follows: predict what is left. (`sequence` does so after the program's last.)"""
        self._add_predictions(self._predictor.finish())

    def _add_predictions(self, layers: list[MixturePrediction]) -> None:
        for along in layers:
            self.statistics.add_mixture(along)
            self.samples.add(along)
            if self._watch is not None:
                self._watch.check(along)

    def _under_alloy_rules(
        self, site: LayerSite, tracks: OrderedTracks, watch: AlloyWatch, *, is_last: bool
    ) -> tuple[OrderedTracks, FloatArray]:
        """Tracks, and time beside what powder needs before each, that lay nothing forbidden."""
        from lmctl.plan.sequence.alloy_attempts import Attempt, tracks_that_keep_rules  # late: too

        state = self._state

        def attempt(tracks: OrderedTracks, wait_s: FloatArray) -> Attempt:
            beads = self._beads(site, tracks)
            moves, durations = self._motion.timed_moves(
                site, state, beads, wait_s, is_last=is_last)
            end_s = state.time_s + np.cumsum(durations)
            flow = self._flow(moves, beads, end_s)
            self._state = state
            return (bead_pieces(0, 0.0, tracks, moves, state.at_mm, state.time_s, end_s,
                                site.placement.offset_mm), moves, end_s, flow)

        return tracks_that_keep_rules(
            tracks, watch, f"layer {site.number + 1}", attempt,
            is_uniform=self._process.strategy == "iso-3d", leads=self._leads)

    def _power_factor(self, number: int, tracks: OrderedTracks, placement: Placement) -> float:
        """Begin the layer's temperature; returns the factor on the recipe's beam power."""
        stated = self._process.power_factor(number)
        if self._heat is None or tracks.n_tracks == 0:
            return stated
        self._heat.begin_layer()
        least = min(self._process.power_range[0] / stated, 1.0)
        points_mm, fractions = tracks.places_every(self._recipe.bead_mm)
        return stated * self._heat.power_factor(
            points_mm + placement.offset_mm[:2], fractions, least)

    def _beads(self, site: LayerSite, tracks: OrderedTracks) -> Beads | None:
        if tracks.n_tracks == 0:
            return None
        drape = site.drape
        max_speed_mm_s = min(self._profile.motion.max_speed_mm_s[:2])
        if drape is not None:
            max_speed_mm_s = min(max_speed_mm_s, self._profile.motion.max_speed_mm_s[2]
                                 / max(drape.steepest_slope(), 1e-6))
        beads = make_beads(
            tracks, self._mixtures, self._process.fraction_step, self._motion.longest_s,
            max_speed_mm_s, f"layer {site.number + 1}",
            leads=self._leads, uniform=self._process.strategy == "iso-3d",
            allowed=None if self._watch is None or tracks.melted is not None
            else self._watch.allowed_levels)
        if site.power_factor != 1:
            beads = replace(beads, power_W=beads.power_W * site.power_factor)
        if drape is None:
            return beads
        return replace(beads, width_mm=beads.width_mm / drape.stretch(beads.points_mm))

    def _drape(self, number: int, placement: Placement) -> LayerDrape | None:
        if self._stack is None:
            return None
        level_mm = placement.nozzle_height_mm(number) - float(placement.offset_mm[2])
        return LayerDrape(self._stack, level_mm, placement.offset_mm)

    def _change_s(self, start: FloatArray, end: FloatArray) -> float:
        flow = self._recipe.flow_g_s
        return float(min_ramp_duration_s(
            flow(start)[None], flow(end)[None], self._limits, self._process.fraction_step)[0])

    def _flow(self, moves: Moves, beads: Beads | None, end_s: FloatArray) -> PowderFlow:
        """Flow wanted at the nozzle during the layer, from where the last one ended."""
        state = self._state
        if beads is None:
            assert state.flow_g_s is not None, "the first layer of a job has tracks"
            times = np.array([state.time_s, end_s[-1]])
            return PowderFlow(times, np.vstack([state.flow_g_s, state.flow_g_s]))
        first, last = bead_line_ranges(moves)
        starts = np.concatenate([[0], np.cumsum(last - first + 2)]).astype(np.intp)
        # A bead's knots are the ends of its lines and of the line before them.
        line = np.repeat(first - 1 - starts[:-1], np.diff(starts)) + np.arange(starts[-1])
        fractions = moves.fractions[line]
        leads_in = moves.path[first - 1] == moves.path[first]
        fractions[starts[:-1]] = np.where(
            leads_in[:, None], moves.fractions[first - 1], beads.fractions[beads.first])
        factor = np.repeat(beads.speed_factor, np.diff(starts))
        wanted = self._recipe.flow_g_s(fractions, factor)
        if state.flow_g_s is None:  # the job begins with its first path's flow
            self._state = state = replace(state, flow_g_s=self._recipe.flow_g_s(
                beads.fractions[0], beads.speed_factor[0]))
        assert state.flow_g_s is not None
        return powder_flow(
            state.time_s, float(end_s[-1]), end_s[line], wanted, starts, self._limits,
            self._process.powder, state.flow_g_s, self._process.change_margin_s, self._pause)
