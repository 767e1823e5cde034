"""One layer after another: section, tracks, order, beads, moves, times, powder, text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import Process
from lmctl.errors import PlanError
from lmctl.job.schema import JobLayer, LineKind, line_dtype
from lmctl.plan.assemble import Way, layer_moves, way_home
from lmctl.plan.beads import Bead, make_bead
from lmctl.plan.coverage import covered_area_mm2, overhang_area_mm2
from lmctl.plan.layer_range import tracks_of
from lmctl.plan.moves import Moves, join, lines, on_raster
from lmctl.plan.nozzle import Nozzle
from lmctl.plan.order import arrange
from lmctl.plan.powder import Flow, layer_flow, limits_of
from lmctl.plan.program import CLOSING, OPENING, program_text
from lmctl.plan.ramps import needed_s
from lmctl.plan.recipe import Recipe, make_recipe
from lmctl.plan.tally import OVERHANG_DEG, Tally
from lmctl.plan.timing import in_short_lines, with_time_for_powder
from lmctl.plan.tracks import Section, Track
from lmctl.preflight.job_check import LINES_PER_HORIZON, beyond_travel
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

FloatArray = NDArray[np.float64]

#: Predictions are made at points at most so far apart in time [s].
_ASK_EVERY_S = 0.05


@dataclass
class _Where:
    """Where planning stands between two layers."""

    at_mm: FloatArray
    time_s: float
    line: int
    path: int
    mixture: FloatArray | None
    flow_g_s: FloatArray | None
    below: Section | None


class LayerPlanner:
    """Plans the layers of one part in order; `tally` sums up those planned so far."""

    def __init__(self, part: Part, profile: MachineProfile, placement: Placement) -> None:
        self._part = part
        self._process: Process = part.process
        self._profile = profile
        self._placement = placement
        self.recipe: Recipe = replace(make_recipe(part.materials, part.process, profile),
                                      layer_height_mm=placement.layer_height_mm)
        self._limits = limits_of(self.recipe)
        self._leads = part.process.powder == "lead"
        self._nozzle = Nozzle(
            self.recipe.dead_time_s, self.recipe.lag_s, self.recipe.max_flow_g_s,
            leads=self._leads)
        self._way = Way(
            travel_mm_s=min(part.process.travel_speed_mm_s, *profile.motion.max_speed_mm_s),
            clearance_mm=profile.motion.clearance_mm,
            lead_in_mm=part.process.lead_in_mm,
            bead_mm=part.process.bead_width_mm,
            dwell_s=part.process.dwell_s if part.process.powder == "dwell" else 0.0,
            dwell_step=part.process.fraction_step,
        )
        self._longest_s = profile.motion.send_horizon_s / LINES_PER_HORIZON
        self._home_mm = np.asarray(profile.motion.purge_mm, dtype=np.float64)
        self.tally = Tally(self.recipe)
        self._where = _Where(self._home_mm, 0.0, 0, 0, None, None, None)

    @property
    def duration_s(self) -> float:
        """Program time at the end of what is planned so far."""
        return self._where.time_s

    def layer(self, index: int) -> JobLayer:
        """Plan the next layer."""
        section = self._part.section(self._placement.cut_mm(index))
        tracks = tracks_of(section, self._process)
        self.tally.add_slice(
            index, *covered_area_mm2(section, tracks, self.recipe.bead_mm),
            overhang_area_mm2(section, self._where.below, self._lean_mm()))
        self._where.below = section
        beads = self._beads(index, tracks)
        self.tally.add_beads(index, beads)
        moves, texts, durations = self._moves(index, beads)
        return self._written(index, beads, moves, texts, durations)

    def _lean_mm(self) -> float:
        return float(self.recipe.layer_height_mm * np.tan(np.radians(OVERHANG_DEG)))

    def _beads(self, index: int, tracks: list[Track]) -> list[Bead]:
        """The layer's beads in the order in which they are laid."""
        if not tracks:
            return []
        cut_mm = self._placement.cut_mm(index)
        points = np.vstack([track.points for track in tracks])
        field = self._part.composition(
            np.column_stack([points, np.full(len(points), cut_mm)]))
        ends = np.cumsum([len(track.points) for track in tracks])[:-1]
        fractions = np.split(field, ends)
        if self._process.strategy == "iso-3d":  # the paper: one composition a contour
            fractions = [np.broadcast_to(f.mean(axis=0), f.shape) for f in fractions]
        step = self._process.fraction_step
        at = self._where.at_mm[:2] - self._placement.offset_mm[:2]
        traces = arrange(
            tracks, fractions, index, at, self._where.mixture, step, self._change_s)
        max_speed = min(self._profile.motion.max_speed_mm_s[:2])
        return [
            make_bead(trace, self.recipe, step, self._longest_s, max_speed,
                      f"layer {index + 1}", leads=self._leads)
            for trace in traces
        ]

    def _change_s(self, start: FloatArray, end: FloatArray) -> float:
        flow = self.recipe.flow_g_s
        return needed_s(flow(start), flow(end), self._limits, self._process.fraction_step)

    def _moves(self, index: int, beads: list[Bead]) -> tuple[Moves, dict[int, str], FloatArray]:
        """The layer's lines, what its setup lines say, and how long each lasts."""
        start = self._where.at_mm
        motion = self._profile.motion
        mixture = self._where.mixture
        if mixture is None:
            mixture = beads[0].fractions[0]
        moves = layer_moves(beads, self._placement.nozzle_mm(index), self._placement.offset_mm,
                            start, self._way, mixture)
        last = index == self._placement.n_layers - 1
        if last:
            mixture = moves.fractions[-1]
            moves = join([moves, way_home(moves.target_mm[-1], self._home_mm, self._way, mixture)])
        moves = on_raster(moves, start)
        self._check_reach(index, moves)
        if self._leads:
            moves = with_time_for_powder(moves, start, motion, self._needs(beads))
        moves, durations = in_short_lines(moves, start, motion, self._longest_s)
        opening = OPENING if index == 0 else ()
        closing = CLOSING if last else ()
        texts = dict(enumerate(opening))
        texts |= {len(opening) + len(moves) + i: text for i, text in enumerate(closing)}
        parts = [moves]
        if opening:
            parts.insert(0, self._setup(len(opening), start, moves.fractions[0]))
        if closing:
            parts.append(self._setup(len(closing), moves.target_mm[-1], moves.fractions[-1]))
        durations = np.concatenate(
            [np.zeros(len(opening)), durations, np.zeros(len(closing))])
        return join(parts), texts, durations

    def _check_reach(self, index: int, moves: Moves) -> None:
        """Refuse, at the first layer, what `check_job` would refuse after the last."""
        ends_mm = moves.target_mm[moves.is_motion()]
        if len(ends_mm) == 0:
            return
        outside = beyond_travel(ends_mm.min(axis=0), ends_mm.max(axis=0), self._profile)
        if outside:
            raise PlanError(
                f"layer {index + 1} of {self._part.name} reaches outside the travel of "
                f"{self._profile.name!r}", where=outside,
                hint=f"lead-in and lead-out go beyond the part by up to "
                     f"{self._process.lead_in_mm:g} mm: lower process.lead_in_mm, or move the part "
                     "with [placement]")

    @staticmethod
    def _setup(count: int, at_mm: FloatArray, mixture: FloatArray) -> Moves:
        return lines(np.repeat(at_mm[None], count, axis=0), feed_mm_s=0.0, kind=LineKind.SETUP,
                     fractions=mixture)

    def _needs(self, beads: list[Bead]) -> Callable[[int], float]:
        """Time the powder needs before each path of this layer."""
        flow = self.recipe.flow_g_s
        step = self._process.fraction_step

        def needed(path: int) -> float:
            bead = beads[path]
            before = (flow(beads[path - 1].fractions[-1], beads[path - 1].pace) if path
                      else self._where.flow_g_s)
            if before is None:
                return 0.0
            return needed_s(before, flow(bead.fractions[0], bead.pace), self._limits, step)

        return needed

    def _written(
        self, index: int, beads: list[Bead], moves: Moves, texts: dict[int, str],
        durations: FloatArray,
    ) -> JobLayer:
        """The layer as the job holds it; planning goes on from its end."""
        where = self._where
        if where.flow_g_s is None:  # the job begins with its first path's flow
            where.flow_g_s = self.recipe.flow_g_s(beads[0].fractions[0], beads[0].pace)
        end_s = where.time_s + np.cumsum(durations)
        flow = layer_flow(moves, where.time_s, end_s, [bead.pace for bead in beads], self.recipe,
                          self._process.powder, where.flow_g_s)
        self.tally.add_program(moves, durations, where.time_s, end_s, flow)
        self._predict(index, moves, end_s, flow)
        table = np.zeros(len(moves), line_dtype(len(self.recipe.hoppers)))
        table["end_s"] = end_s
        table["x_mm"], table["y_mm"], table["z_mm"] = moves.target_mm.T
        table["speed_mm_s"] = moves.feed_mm_s
        table["power_W"] = moves.power_W
        table["path"] = np.where(moves.path >= 0, moves.path + where.path, -1)
        table["kind"] = moves.kind
        table["fractions"] = moves.fractions
        layer = JobLayer(
            index=index, z_mm=self._placement.nozzle_mm(index), first_line=where.line,
            program=program_text(moves, where.line, self._profile.laser, texts),
            lines=table, flow_s=flow.times_s, flow_g_s=flow.g_s)
        where.at_mm = moves.target_mm[-1]
        where.time_s = float(end_s[-1])
        where.line += len(moves)
        where.path += len(beads)
        where.flow_g_s = flow.g_s[-1]
        if beads:
            where.mixture = beads[-1].fractions[-1]
        return layer

    def _predict(self, index: int, moves: Moves, end_s: FloatArray, flow: Flow) -> None:
        """What the nozzle will lay along this layer's beads, against plan and part."""
        bead = np.flatnonzero(moves.kind == LineKind.BEAD)
        if len(bead) == 0:
            return
        begin_s = np.concatenate([[self._where.time_s], end_s[:-1]])[bead]
        before_mm = np.vstack([self._where.at_mm, moves.target_mm[:-1]])[bead]
        before = np.vstack([moves.fractions[:1], moves.fractions[:-1]])[bead]
        length = np.linalg.norm(moves.target_mm[bead] - before_mm, axis=1)
        pieces = np.maximum(1, np.ceil((end_s[bead] - begin_s) / _ASK_EVERY_S).astype(np.intp))
        line = np.repeat(np.arange(len(bead)), pieces)
        number = np.arange(len(line)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        share = (number + 0.5) / pieces[line]
        ask_s = begin_s[line] + share * (end_s[bead] - begin_s)[line]
        laid = self.recipe.laid_fractions(
            self._nozzle.advance(flow.times_s, flow.g_s, ask_s))
        planned = before[line] + share[:, None] * (moves.fractions[bead] - before)[line]
        at_mm = before_mm[line] + share[:, None] * (moves.target_mm[bead] - before_mm)[line]
        at_mm -= self._placement.offset_mm
        at_mm[:, 2] = self._placement.cut_mm(index)
        self.tally.add_mixture(
            length[line] / pieces[line], laid, planned, self._part.composition(at_mm))
