"""The lines of a layer: its beads, the way between them, and the time that powder needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.job.schema import LineKind
from lmctl.plan.program_text.layer_text import CLOSING_LINES, OPENING_LINES
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.beam_off_waits import PurgePosition, with_waits
from lmctl.plan.sequence.draping import LayerDrape, draped_moves
from lmctl.plan.sequence.line_timing import split_long_lines, with_time_for_powder
from lmctl.plan.sequence.mixture_ramps import needed_before_beads_s, powder_limits_of
from lmctl.plan.sequence.moves import Moves, join_moves, moves_of_kind, rounded_to_program_steps
from lmctl.plan.sequence.sequence_state import SequenceState
from lmctl.plan.sequence.travel import (
    LAYER_REST_S,
    TravelSettings,
    layer_moves,
    moves_to_purge_position,
)
from lmctl.preflight.job_check import LINES_PER_HORIZON, travel_violations
from lmctl.preflight.placement import Placement


@dataclass(frozen=True)
class LayerSite:
    """Where a layer lies.

    number : in the placement, from 0; drape : its shape over a substrate; None: level
    cross_mm : height at which the way to it crosses what is built already; None: beside it
    power_factor : on the recipe's beam power
    """

    number: int
    placement: Placement
    drape: LayerDrape | None
    cross_mm: float | None
    power_factor: float = 1.0


class LayerMotion:
    """Makes the lines of one part's layers, each from where the nozzle is and what it delivers."""

    def __init__(
        self, part_name: str, process: ProcessSettings, recipe: Recipe, profile: MachineProfile
    ) -> None:
        self._part_name = part_name
        self._process = process
        self._recipe = recipe
        self._profile = profile
        self._limits = powder_limits_of(recipe)
        self._leads = process.powder == "lead"
        self._travel = TravelSettings(
            travel_mm_s=min(process.travel_speed_mm_s, *profile.motion.max_speed_mm_s),
            clearance_mm=profile.motion.clearance_mm,
            lead_in_mm=process.lead_in_mm,
            bead_mm=process.bead_width_mm,
            dwell_s=process.dwell_s if process.powder == "dwell" else 0.0,
            dwell_step=process.fraction_step,
        )
        self._purge = PurgePosition(
            np.asarray(profile.motion.purge_mm, dtype=np.float64), self._travel)
        self._longest_s = profile.motion.send_horizon_s / LINES_PER_HORIZON

    @property
    def purge(self) -> PurgePosition:
        """Where the nozzle waits and ends."""
        return self._purge

    @property
    def longest_s(self) -> float:
        """A line lasts at most so long."""
        return self._longest_s

    @property
    def clearance_mm(self) -> float:
        """How far above what is built the nozzle travels."""
        return self._travel.clearance_mm

    def timed_moves(
        self, site: LayerSite, state: SequenceState, beads: Beads | None,
        wait_s: FloatArray | None, heat_wait_s: FloatArray | None = None, *, is_last: bool,
    ) -> tuple[Moves, FloatArray]:
        """The layer's lines and how long each lasts, (n,) [s].

        wait_s, heat_wait_s : (m,) before each bead, beside what powder needs
        """
        start, motion = state.at_mm, self._profile.motion
        moves = self.moves(site, state, beads, wait_s, is_last=is_last)
        if heat_wait_s is not None:
            moves = with_waits(moves, start, motion, heat_wait_s, self._purge)
        moves, durations = split_long_lines(moves, start, motion, self._longest_s)
        parts, lasting = [moves], [durations]
        if state.line == 0:
            parts.insert(0, self._setup(len(OPENING_LINES), start, moves.fractions[0]))
            lasting.insert(0, np.zeros(len(OPENING_LINES)))
        if is_last:
            parts.append(self._setup(len(CLOSING_LINES), moves.target_mm[-1], moves.fractions[-1]))
            lasting.append(np.zeros(len(CLOSING_LINES)))
        return join_moves(parts), np.concatenate(lasting)

    def moves(
        self, site: LayerSite, state: SequenceState, beads: Beads | None,
        wait_s: FloatArray | None, *, is_last: bool,
    ) -> Moves:
        """The layer's lines, with the time that powder needs, and wait_s (m,) beside it."""
        start, motion = state.at_mm, self._profile.motion
        mixture = state.mixture
        if mixture is None:
            assert beads is not None, "the first layer of a job has tracks"
            mixture = beads.fractions[0]
        if beads is None:
            moves = moves_of_kind(start, feed_mm_s=0.0, kind=LineKind.DWELL, fractions=mixture,
                                  dwell_s=LAYER_REST_S)
        else:
            moves = self._layer_moves(site, start, beads, mixture)
        if is_last:
            end = moves.target_mm[-1].copy()
            if site.drape is not None:
                end[2] = max(end[2], site.drape.highest_around_mm())
            moves = join_moves([moves, moves_to_purge_position(
                end, self._purge.place_mm, self._travel, moves.fractions[-1])])
        moves = rounded_to_program_steps(moves, start)
        self._check_reach(site.number, moves)
        if self._leads and beads is not None:
            needed_s = self._needed_s(state, beads)
            moves = with_time_for_powder(
                moves, start, motion, needed_s if wait_s is None else needed_s + wait_s)
        return moves

    def _layer_moves(
        self, site: LayerSite, start: FloatArray, beads: Beads, mixture: FloatArray
    ) -> Moves:
        """The moves of a layer, at one height or on its substrate's shape."""
        flat_z_mm = site.placement.nozzle_height_mm(site.number)
        offset_mm, drape = site.placement.offset_mm, site.drape
        if drape is None and site.cross_mm is None:
            return layer_moves(beads, flat_z_mm, offset_mm, start, self._travel, mixture)
        if drape is None:
            above = np.array([*start[:2], site.cross_mm])
            moves = layer_moves(beads, flat_z_mm, offset_mm, above, self._travel, mixture)
            moves.target_mm[0] = start  # the rest at the layer's beginning, before it goes up
            return moves
        above = np.array([*start[:2], flat_z_mm + 1.0])  # so that it comes from above the layer
        flat = layer_moves(beads, flat_z_mm, offset_mm, above, self._travel, mixture)
        return draped_moves(flat, start, flat_z_mm, drape, self._travel.clearance_mm)

    @staticmethod
    def _setup(count: int, at_mm: FloatArray, mixture: FloatArray) -> Moves:
        return moves_of_kind(np.repeat(at_mm[None], count, axis=0), feed_mm_s=0.0,
                             kind=LineKind.SETUP,
                             fractions=mixture)

    def _needed_s(self, state: SequenceState, beads: Beads) -> FloatArray:
        """Time the powder needs before each path of this layer, (m,)."""
        flow = self._recipe.flow_g_s(
            beads.fractions, np.repeat(beads.speed_factor, np.diff(beads.starts)))
        first, last = flow[beads.first], flow[beads.last]
        before = first[0] if state.flow_g_s is None else state.flow_g_s
        return needed_before_beads_s(
            np.vstack([before, last[:-1]]), first, self._limits, self._process.fraction_step,
            self._process.change_margin_s)

    def _check_reach(self, number: int, moves: Moves) -> None:
        """Refuse, at the first layer, motion that `check_job` would refuse after the last."""
        if not moves.is_motion().any():
            return
        low_mm, high_mm = moves.motion_bounds_mm()
        outside = travel_violations(low_mm.tolist(), high_mm.tolist(), self._profile)
        if outside:
            raise PlanError(
                f"layer {number + 1} of {self._part_name} reaches outside the travel of "
                f"{self._profile.name!r}", where=outside,
                hint=f"lead-in and lead-out go beyond the part by up to "
                     f"{self._process.lead_in_mm:g} mm: lower process.lead_in_mm, or move the part "
                     "with [placement]")
