"""Predict temperature layer by layer, and choose waits so that no place is too hot for its bead.

A layer is first tried without waits. Where a place would be too hot, the layer is gone through
block by block (`block_waits`). Blocks begin where powder changes, so that powder and heat wait
together, with other paths, and within long paths; a path is interrupted only where it has to wait.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NoReturn

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.errors import PlanError
from lmctl.job.schema import LayerHeat, LineKind
from lmctl.part.materials.build_heat import BuildHeat
from lmctl.plan.heat.block_waits import NO_PLACES, BlockWaits, LimitNotKeptError, PassLimit
from lmctl.plan.heat.cooling import LONGEST_WAIT_S, HottestPlace
from lmctl.plan.heat.following_power import following_power_factor
from lmctl.plan.heat.heat_choice import HeatChoice, PredictedReadings
from lmctl.plan.heat.heat_grid import heat_grid
from lmctl.plan.heat.heat_steps import NO_LINES, BeadLines
from lmctl.plan.heat.part_temperature import PartTemperature
from lmctl.plan.heat.reading_moments import reading_moments
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.interrupted_beads import HeatWaits
from lmctl.plan.sequence.moves import Moves

#: Waits are aimed below the limit by this part of its rise over the plate, and predictions above it
#: by as much keep it: it is far less than predictions are uncertain by.
_TOLERANCE = 0.02
#: Block by block, steps of time begin elsewhere, so readings differ by some per cent. Where such a
#: pass finds nothing above the limit, it is done again with one lower by so many times the excess.
_LOWER_LIMITS = (0.0, 1.0, 2.0)
#: As good as now [s].
_MOMENT_S = 1e-3


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
        grid = heat_grid(low_mm[:2], high_mm[:2], recipe.bead_mm, recipe.layer_height_mm)
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

    def power_factor(self, place_mm: FloatArray, fractions: FloatArray, least: float) -> float:
        """Factor on the recipe's beam power in the layer begun; 1 where it follows no temperature.

        place_mm, fractions : (n, 2) places of its tracks in program coordinates, and what is laid
            there, (n, materials); least : it does not fall below
        """
        if self._heat.melting_C is None:
            return 1.0
        return following_power_factor(
            np.minimum(self.surface_C(place_mm), self._limit_C),  # what is hotter is waited for
            float(fractions.mean(axis=0) @ self._heat.melting_C), self._heat.plate.at_C, least)

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
        above_K = float(np.nanmax(readings.found_C, initial=-np.inf)) - self._limit_C
        if above_K <= self.tolerance_K:
            self._choice = replace(self._choice, trial=(trial, readings))
            return waits
        for lower in _LOWER_LIMITS:
            limit = PassLimit(self._limit_C - lower * above_K, self.tolerance_K,
                              self._heat.plate.at_C)
            try:
                waits = BlockWaits(self._temperature, lines, first, along_mm, self._recipe.bead_mm,
                                   limit).choose()
            except LimitNotKeptError as error:
                self._refuse(layer, error.hottest)
            if waits.total_s > 0:
                break
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
                self._temperature.time_s + float(durations_s.sum()), NO_LINES, *NO_PLACES)
            return
        if self._choice.trial is not None:
            self._temperature, readings = self._choice.trial
        else:
            lines, _, _ = self._bead_lines(moves, start_mm, durations_s)
            readings = _read_layer(
                self._temperature, lines, float(durations_s.sum()), self._recipe.bead_mm)
        self.readings = readings
        self._record(layer, readings, power_factor)

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
        the tracks each begins and ends, (n, 2)."""
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
        ), np.flatnonzero(np.diff(path, prepend=-1)), moves.along_mm[bead]

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
