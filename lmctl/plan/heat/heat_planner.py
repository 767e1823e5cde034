"""Predict temperature layer by layer, and choose waits so that no place is too hot for its bead.

A layer is first tried without waits. Where a place would be too hot, the layer is gone through
block by block: before each the beam stays off until all its places are cool enough when they are
reached. Blocks begin where powder changes, so that powder and heat wait together, with other paths,
and within long paths; a path is interrupted only where it has to wait.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NoReturn

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.errors import PlanError
from lmctl.job.schema import LayerHeat, LineKind
from lmctl.part.materials.build_heat import BuildHeat
from lmctl.plan.heat.cooling import (
    LONGEST_WAIT_S,
    HottestPlace,
    PassReadings,
    wait_for_limit_s,
)
from lmctl.plan.heat.heat_blocks import MIN_PIECE_BEADS, block_starts, middle_of_block
from lmctl.plan.heat.heat_choice import HeatChoice, PredictedReadings
from lmctl.plan.heat.heat_grid import heat_grid
from lmctl.plan.heat.heat_steps import NO_LINES, BeadLines
from lmctl.plan.heat.part_temperature import PartTemperature
from lmctl.plan.heat.reading_moments import CLEAR_S, reading_moments
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.interrupted_beads import HeatWaits
from lmctl.plan.sequence.moves import Moves

#: Waits are aimed below the limit by this part of its rise over the plate, and predictions above it
#: by as much keep it: it is far less than predictions are uncertain by.
_TOLERANCE = 0.02
#: As good as now [s].
_MOMENT_S = 1e-3
#: A wait is corrected so often, since a longer wait changes a little what the pass itself adds.
_ROUNDS = 4


class HeatPlanner:
    """The temperature of one part as its layers are planned in order.

    layers : what was predicted and chosen for each layer so far
    readings : of the layer planned last
    tolerance_K : by which a prediction may exceed the limit
    """

    def __init__(
        self, heat: BuildHeat, limit_C: float, recipe: Recipe, low_mm: FloatArray,
        high_mm: FloatArray,
    ) -> None:
        """low_mm, high_mm : corners of the part, program coordinates (x and y count)"""
        self._heat, self._limit_C, self._recipe = heat, limit_C, recipe
        self.tolerance_K = _TOLERANCE * (limit_C - heat.plate.at_C)
        grid = heat_grid(low_mm[:2], high_mm[:2], recipe.bead_mm, recipe.layer_height_mm,
                         heat.diffusivity_mm2_s)
        self._temperature = PartTemperature(
            grid, heat.plate, recipe.layer_height_mm, float(heat.diffusivity_mm2_s.max()))
        self._choice = HeatChoice()
        self.layers: list[LayerHeat] = []
        self.readings: PredictedReadings | None = None

    @property
    def limit_C(self) -> float:
        """What the beam may come back to."""
        return self._limit_C

    def begin_layer(self) -> None:
        """From here on lines are those of the next layer that has beads."""
        self._temperature.begin_layer()
        self.begin_attempt("nearest")

    def begin_attempt(self, order: str) -> None:
        """From here on waits are those of its tracks in another order (`LayerHeat.order`)."""
        self._choice = HeatChoice(order=order)

    def surface_C(self, place_mm: FloatArray) -> FloatArray:
        """Temperatures that the layer begun finds at places (r, 2), program coordinates; NaN beside
        what there is."""
        now = self._temperature.copy()
        return now.advance(now.time_s + _MOMENT_S, NO_LINES, np.full(len(place_mm), now.time_s),
                           place_mm)

    @property
    def choice(self) -> HeatChoice:
        """What was chosen for the layer so far; set it to go back to another attempt."""
        return self._choice

    @choice.setter
    def choice(self, choice: HeatChoice) -> None:
        self._choice = choice

    def choose_waits(
        self, layer: int, moves: Moves, start_mm: FloatArray, durations_s: FloatArray,
    ) -> HeatWaits:
        """The waits that a layer needs beside those that its lines have; call again with these.

        layer : its number in the job, from 0, for messages
        moves, durations_s : lines of the layer with all time that powder needs, from `start_mm`
        Raises PlanError where no wait up to an hour is long enough.
        """
        lines, first, along_mm = self._bead_lines(moves, start_mm, durations_s)
        waits = HeatWaits(np.zeros(len(first)), np.empty(0), np.empty(0))
        trial = self._temperature.copy()
        readings = _read_layer(trial, lines, float(durations_s.sum()), self._recipe.bead_mm)
        if np.nanmax(readings.found_C, initial=-np.inf) <= self._limit_C + self.tolerance_K:
            self._choice = replace(self._choice, trial=(trial, readings))
            return waits
        waits = self._block_waits(layer, lines, first, along_mm)
        self._choice = replace(
            self._choice, trial=None, waited_s=self._choice.waited_s + waits.total_s,
            cuts=self._choice.cuts + len(waits.cut_s))
        return waits

    def add_layer(
        self, layer: int, moves: Moves, start_mm: FloatArray, durations_s: FloatArray,
        power_factor: float,
    ) -> None:
        """Go on by a layer, with its lines as they are written."""
        if not (moves.kind == LineKind.BEAD).any():
            self._temperature.advance(
                self._temperature.time_s + float(durations_s.sum()), NO_LINES, *_NOTHING)
            return
        if self._choice.trial is not None:
            self._temperature, readings = self._choice.trial
        else:
            lines, _, _ = self._bead_lines(moves, start_mm, durations_s)
            readings = _read_layer(
                self._temperature, lines, float(durations_s.sum()), self._recipe.bead_mm)
        self.readings = readings
        self._record(layer, readings, power_factor)

    def _block_waits(
        self, layer: int, lines: BeadLines, first: IndexArray, along_mm: FloatArray
    ) -> HeatWaits:
        """Go through a layer block by block, and wait before each as long as it takes."""
        temperature = self._temperature.copy()
        began_s, shift_s = temperature.time_s, 0.0
        moments = reading_moments(
            lines.start_mm, lines.end_mm, lines.start_s, lines.end_s, self._recipe.bead_mm)
        piece_mm = MIN_PIECE_BEADS * self._recipe.bead_mm
        blocks = list(pairwise([*block_starts(lines, first, piece_mm), len(lines.start_s)]))[::-1]
        before_s = np.zeros(len(first))
        cut_along, cut_s = [], []
        while blocks:
            a, b = blocks.pop()
            mine = np.flatnonzero((moments.owner >= a) & (moments.owner < b))
            mine = mine[np.argsort(moments.at_s[mine], kind="stable")]
            temperature.advance(began_s + float(lines.start_s[a]) + shift_s, NO_LINES, *_NOTHING)
            # read before this block, but not if the beam stays off here
            again = np.flatnonzero((moments.line >= a) & (moments.owner < a))
            middle = middle_of_block(lines, first, a, b, piece_mm)
            wait_s, after, is_cool = self._wait_s(
                layer, temperature, lines.part(a, b, began_s + shift_s), moments.place_mm[mine],
                moments.at_s[mine] + began_s + shift_s, moments.place_mm[again],
                can_divide=middle is not None)
            if middle is not None and not is_cool:  # there may be a wait within it
                blocks += [(middle, b), (a, middle)]
                continue
            temperature = after
            path = int(np.searchsorted(first, a, side="right")) - 1
            if first[path] == a:
                before_s[path] = wait_s
            elif wait_s > 0:
                cut_along.append(along_mm[a])
                cut_s.append(wait_s)
            shift_s += wait_s
        return HeatWaits(before_s, np.array(cut_along), np.array(cut_s))

    def _wait_s(
        self, layer: int, before: PartTemperature, block: BeadLines, place_mm: FloatArray,
        at_s: FloatArray, again_mm: FloatArray, *, can_divide: bool,
    ) -> tuple[float, PartTemperature, bool]:
        """The wait before a block of lines, the part after it, and whether the limit is kept.

        place_mm, at_s : places read during the block, and when without a wait
        again_mm : places that are read at its start if there is a wait
        can_divide : whether there may be a wait within it
        """
        wait_s, is_cool = 0.0, False
        for _ in range(_ROUNDS):
            after = before.copy()
            after.advance(before.time_s + wait_s, NO_LINES, *_NOTHING)
            waited = after.copy() if wait_s else before
            read = after.advance(float(block.end_s[-1]) + wait_s, block.part(
                0, len(block.start_s), wait_s), at_s + wait_s, place_mm)
            is_cool = bool(np.nanmax(read, initial=-np.inf) <= self._limit_C)
            if is_cool:
                break
            more_s = wait_for_limit_s(
                waited, PassReadings(place_mm, at_s + wait_s - waited.time_s, read),
                self._limit_C - self.tolerance_K, self._heat.plate.at_C, can_divide=can_divide)
            if isinstance(more_s, HottestPlace):
                self._refuse(layer, more_s)
            if more_s <= 0:
                break
            if wait_s == 0:
                more_s = max(more_s, CLEAR_S)
                at_s = np.concatenate([np.full(len(again_mm), before.time_s), at_s])
                place_mm = np.vstack([again_mm, place_mm])
            wait_s += more_s
        return wait_s, after, is_cool

    def _refuse(self, layer: int, hottest: HottestPlace) -> NoReturn:
        x, y = hottest.place_mm.tolist()
        raise PlanError(
            f"the interpass limit of {self._limit_C:g} °C cannot be kept by waiting: in layer "
            f"{layer + 1}, at x {x:.1f}, y {y:.1f}, the beam comes back to "
            f"{hottest.found_C:.0f} °C even after {LONGEST_WAIT_S / 60:.0f} minutes",
            where="process.interpass_max_C",
            hint="raise the limit, lower power_W or the plate's temperature, or improve the "
                 "plate's contact with the table (substrate.contact_W_m2_K)")

    def _bead_lines(
        self, moves: Moves, start_mm: FloatArray, durations_s: FloatArray
    ) -> tuple[BeadLines, IndexArray, FloatArray]:
        """Bead lines with times from the layer's start, the first one of each path, and where on
        the tracks each begins."""
        recipe, heat = self._recipe, self._heat
        bead = np.flatnonzero(moves.kind == LineKind.BEAD)
        ends_s = np.cumsum(durations_s)
        before_mm = np.vstack([start_mm, moves.target_mm[:-1]])[bead, :2]
        end_mm, fractions = moves.target_mm[bead, :2], moves.fractions[bead]
        strip_mm = moves.bead_width_mm[bead] * (recipe.pitch_mm / recipe.bead_mm)
        length_mm = np.sqrt(((end_mm - before_mm) ** 2).sum(axis=1))
        volume_mm3 = length_mm * strip_mm * recipe.layer_height_mm
        path = moves.path[bead]
        return BeadLines(
            start_mm=before_mm, end_mm=end_mm, start_s=ends_s[bead] - durations_s[bead],
            end_s=ends_s[bead], strip_mm=strip_mm,
            power_W=moves.power_W[bead] * (fractions @ heat.absorptivity),
            volume_mm3=volume_mm3, capacity_J_K=volume_mm3 * (fractions @ heat.capacity_J_mm3_K),
            conductivity_mm3=volume_mm3 * (fractions @ heat.conductivity_W_mm_K),
        ), np.flatnonzero(np.diff(path, prepend=-1)), moves.along_mm[bead, 0]

    def _record(
        self, layer: int, readings: PredictedReadings, power_factor: float
    ) -> None:
        hottest = int(np.nanargmax(np.append(readings.found_C, -np.inf)))
        known = hottest < len(readings.found_C)
        x, y = readings.place_mm[hottest].tolist() if known else (0.0, 0.0)
        reached_C = float(readings.found_C[hottest]) if known else self._heat.plate.at_C
        self.layers.append(LayerHeat(
            layer=layer, interpass_C=round(reached_C, 1), x_mm=round(x, 2), y_mm=round(y, 2),
            wait_s=round(self._choice.waited_s, 2), cuts=self._choice.cuts,
            power_factor=round(power_factor, 4), order=self._choice.order))


_NOTHING = (np.empty(0), np.empty((0, 2)))


def _read_layer(
    temperature: PartTemperature, lines: BeadLines, lasting_s: float, bead_mm: float
) -> PredictedReadings:
    """Advance by a layer's lines, with times from its start, and read its places."""
    began_s = temperature.time_s
    moments = reading_moments(
        lines.start_mm, lines.end_mm, lines.start_s, lines.end_s, bead_mm)
    order = np.argsort(moments.at_s, kind="stable")
    found = np.empty(len(order))
    found[order] = temperature.advance(
        began_s + lasting_s, lines.part(0, len(lines.start_s), began_s),
        began_s + moments.at_s[order], moments.place_mm[order])
    return PredictedReadings(moments.place_mm, moments.at_s, found)
