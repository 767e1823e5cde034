"""Sum up statistics of the plan, layer by layer, and report findings from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.job.schema import LayerMixture, LineKind
from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.flat_arrays import greatest_differences
from lmctl.plan.sequence.mixture_prediction import MixturePrediction
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION

#: The part of the path that should have its mixture.
MIN_CORRECT_MIXTURE_FRACTION = 0.99
#: Mixtures that differ by more are not the same; allows for rounding at exactly the tolerance.
_LEAST_DIFFERENCE = MIXTURE_TOLERANCE_FRACTION + 1e-9


@dataclass
class PlanStatistics:
    """Sums over the layers so far; `totals` and `plan_report` read them at the end."""

    recipe: Recipe
    has_alloy_rules: bool = False
    layers: int = 0
    empty_layers: list[int] = field(default_factory=list)
    contours: int = 0
    vertices: int = 0
    lines: int = 0
    path_mm: float = 0.0
    laser_on_s: float = 0.0
    longest_line_s: float = 0.0
    peak_power_W: float = 0.0
    planned_mm2: float = 0.0
    deposited_mm3: float = 0.0
    rounded_mixture_mm: float = 0.0
    rounded_by: float = 0.0
    slowed_mm: float = 0.0
    least_speed_factor: float = 1.0
    cuts: int = 0
    uncut: int = 0
    mm_above_recipe_speed: float = 0.0
    greatest_speed_factor: float = 1.0
    correct_mixture_mm: float = 0.0
    asked_mm: float = 0.0
    unplanned_mm: float = 0.0
    unfollowed_mm: float = 0.0
    worst_mixture: float = 0.0
    mixtures: list[LayerMixture] = field(default_factory=list)
    fed_g: FloatArray = field(default_factory=lambda: np.zeros(0))
    wasted_g: FloatArray = field(default_factory=lambda: np.zeros(0))
    caught_g: FloatArray = field(default_factory=lambda: np.zeros(0))
    peak_flow_g_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    low_mm: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    high_mm: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))

    def __post_init__(self) -> None:
        m = len(self.recipe.hoppers)
        self.fed_g, self.wasted_g, self.peak_flow_g_s = np.zeros(m), np.zeros(m), np.zeros(m)
        self.caught_g = np.zeros(m)

    def add_beads(self, layer: int, geometry: LayerGeometry, beads: Beads | None) -> None:
        """The beads of layer `layer` of the job; None where its slice has no tracks."""
        self.layers += 1
        self.planned_mm2 += geometry.figures.slice_mm2
        if beads is None:
            self.empty_layers.append(layer)
            return
        length = beads.lengths_mm()
        factor = np.repeat(beads.speed_factor, np.diff(beads.starts))
        middle = beads.fractions.copy()
        middle[1:] = (middle[1:] + middle[:-1]) / 2
        rate = self.recipe.pitch_mm * self.recipe.layer_height_mm * factor
        deposited_mm3 = float(
            (length / beads.speed_mm_s * rate * self.recipe.speed(middle)).sum())
        self.deposited_mm3 += deposited_mm3
        self.contours += beads.count
        self.vertices += len(beads.points_mm)
        self.path_mm += float(length.sum())
        self.rounded_mixture_mm += beads.rounded_mixture_mm
        self.rounded_by = max(self.rounded_by, beads.rounded_by)
        slowed = factor < 1
        self.slowed_mm += float(length[slowed].sum())
        self.least_speed_factor = min(self.least_speed_factor, float(factor.min()))
        self.mm_above_recipe_speed += float(length[factor > 1].sum())
        self.greatest_speed_factor = max(self.greatest_speed_factor, float(factor.max()))
        self.peak_power_W = max(
            self.peak_power_W, float(np.delete(beads.power_W, beads.first).max()))

    def add_cuts(self, cuts: int, too_short: int) -> None:
        """Cuts of one layer's tracks, and places where a piece would have been too short."""
        self.cuts += cuts
        self.uncut += too_short

    def add_program(
        self, moves: Moves, durations_s: FloatArray, start_s: float, end_s: FloatArray,
        flow: PowderFlow,
    ) -> None:
        """One layer's lines and flow: times, reach, powder."""
        bead = moves.kind == LineKind.BEAD
        self.lines += len(moves)
        self.laser_on_s += float(durations_s[bead].sum())
        self.longest_line_s = max(self.longest_line_s, float(durations_s.max()))
        low_mm, high_mm = moves.motion_bounds_mm()
        self.low_mm = np.minimum(self.low_mm, low_mm)
        self.high_mm = np.maximum(self.high_mm, high_mm)
        fed = np.diff(_fed_g(flow.times_s, np.ascontiguousarray(flow.g_s),
                             np.concatenate([[start_s], end_s])), axis=0)
        self.fed_g += fed.sum(axis=0)
        self.wasted_g += fed[~bead].sum(axis=0)
        if self.recipe.mixture_catch is not None:
            self.caught_g += (fed * self.recipe.catch_at(fed))[bead].sum(axis=0)
        self.peak_flow_g_s = np.maximum(self.peak_flow_g_s, flow.g_s.max(axis=0))

    def add_mixture(self, along: MixturePrediction) -> None:
        """What a layer of the job is predicted to be deposited of; layers come in order."""
        pieces, predicted, m = along.pieces, along.predicted, len(self.recipe.materials)
        length_mm = pieces.length_mm
        self.mixtures.append(LayerMixture(pieces.layer, *(
            tuple((length_mm @ fractions / length_mm.sum()).round(4).tolist())
            for fractions in (pieces.designed[:, :m], pieces.fed, predicted[:, :m]))))
        self.asked_mm += float(length_mm.sum())
        off = greatest_differences(predicted, pieces.designed)
        self.correct_mixture_mm += float(length_mm[off <= _LEAST_DIFFERENCE].sum())
        self.worst_mixture = max(self.worst_mixture, float(off.max(initial=0.0)))
        by_steps = greatest_differences(pieces.planned, pieces.designed)
        self.unplanned_mm += float(length_mm[by_steps > _LEAST_DIFFERENCE].sum())
        by_powder = greatest_differences(predicted, pieces.planned)
        self.unfollowed_mm += float(length_mm[by_powder > _LEAST_DIFFERENCE].sum())

    def totals(self, duration_s: float, warnings: list[str]) -> dict[str, Any]:
        """What `lmctl plan --json` prints."""
        names = [material.name for material in self.recipe.materials]
        hoppers = [hopper.name for hopper in self.recipe.hoppers]
        caught_g = (self.caught_g if self.recipe.mixture_catch is not None
                    else (self.fed_g - self.wasted_g) * self.recipe.catch_efficiency)
        height_mm = self.recipe.layer_height_mm

        def by(keys: list[str], values: FloatArray, digits: int = 3) -> dict[str, float]:
            return {k: round(float(v), digits) for k, v in zip(keys, values, strict=True)}

        return {
            "layers": self.layers,
            "contours": self.contours,
            "vertices": self.vertices,
            "lines": self.lines,
            "path_length_mm": round(self.path_mm, 3),
            "laser_on_s": round(self.laser_on_s, 3),
            "duration_s": round(duration_s, 3),
            "powder_g": by(names, self.fed_g),
            "powder_in_part_g": by(names, caught_g),
            "powder_beam_off_g": by(names, self.wasted_g),
            "peak_flow_g_min": by(hoppers, self.peak_flow_g_s * 60),
            "peak_power_W": round(self.peak_power_W, 1),
            "longest_line_s": round(self.longest_line_s, 6),
            "slice_volume_mm3": round(self.planned_mm2 * height_mm, 3),
            "deposited_volume_mm3": round(self.deposited_mm3, 3),
            "filling": round(self.filling_ratio, 5),
            "mixture_share": round(self.correct_mixture_fraction, 5),
            "mixture_worst": round(self.worst_mixture, 4),
            "warnings": warnings,
        }

    @property
    def filling_ratio(self) -> float:
        """Deposited volume over that of the planned slices, wherever it lies."""
        slice_mm3 = self.planned_mm2 * self.recipe.layer_height_mm
        return self.deposited_mm3 / slice_mm3 if slice_mm3 else 0.0

    @property
    def correct_mixture_fraction(self) -> float:
        return self.correct_mixture_mm / self.asked_mm if self.asked_mm else 1.0


@kernel
def _fed_g(times_s: FloatArray, flow_g_s: FloatArray, at_s: FloatArray) -> FloatArray:
    """Mass since the first knot at each time, (n, hoppers) [g]; exact for linear flow.

    times_s : (k,) rising, k ≥ 2; flow_g_s : (k, hoppers), linear in between; at_s : (n,) rising
    """
    hoppers = flow_g_s.shape[1]
    mass = np.empty((len(at_s), hoppers))
    done = np.zeros(hoppers)  # up to knot k
    k = 0
    for n in range(len(at_s)):
        while k + 2 < len(times_s) and times_s[k + 1] <= at_s[n]:
            for m in range(hoppers):
                done[m] += (times_s[k + 1] - times_s[k]) * (
                    flow_g_s[k + 1, m] + flow_g_s[k, m]) / 2
            k += 1
        into = at_s[n] - times_s[k]
        for m in range(hoppers):
            slope = (flow_g_s[k + 1, m] - flow_g_s[k, m]) / (times_s[k + 1] - times_s[k])
            mass[n, m] = done[m] + into * (flow_g_s[k, m] + slope * into / 2)
    return mass
