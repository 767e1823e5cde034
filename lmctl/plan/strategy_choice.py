"""Choose a strategy for a part by planning some of its layers with each and comparing.

Compared are the share of path that gets its mixture, also where dead times are not what the profile
says, the time, and the starts. The fastest plan whose share is about as good as the best is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.job.schema import LineKind
from lmctl.plan.geometry import LayerGeometry, layer_geometry
from lmctl.plan.program_text import LayerLines
from lmctl.plan.recipe import Recipe, recipe_of
from lmctl.plan.sequence.flat_arrays import indices_within_stretches
from lmctl.plan.sequence.layer_sequencer import LayerSequencer
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION
from lmctl.preflight.part_check import check_part
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: Layers are tried at these parts of the height.
_TRIED_AT = (0.15, 0.5, 0.85)
#: A share of path this much below the best is as good.
_AS_GOOD = 0.03
#: Mixtures are compared at points at most so far apart in time [s].
_EVERY_S = 0.05


@dataclass(frozen=True)
class StrategyTrial:
    """Some layers of a part, planned in one way.

    right : share of the path within tolerance of the part's mixture, as predicted
    right_at_worst : the same where all dead times are longer, or shorter, by `dead_time_error_s`
    time_s, starts : of the layers tried; built : volume inside their surface, over theirs
    """

    strategy: str
    change_margin_s: float
    right: float
    right_at_worst: float
    time_s: float
    starts: int
    built: float

    @property
    def way(self) -> str:
        """Strategy and waits, in words."""
        waits = f" with {self.change_margin_s:g} s around changes" if self.change_margin_s else ""
        return f"{self.strategy}{waits}"

    def as_text(self) -> str:
        """What was found, in words."""
        return (f"{self.way}: {self.right:.1%} right, {self.right_at_worst:.1%} at "
                f"worst, {self.time_s:.0f} s, {self.starts} starts")


@dataclass(frozen=True)
class StrategyChoice:
    """What was chosen of what was tried, and on which layers of the part, from 1."""

    chosen: StrategyTrial
    trials: tuple[StrategyTrial, ...]
    layers: tuple[int, ...]
    dead_time_error_s: float

    def as_text(self) -> str:
        """Why, in a sentence for people."""
        if len(self.trials) == 1:
            return f"strategy {self.chosen.strategy}: the part is of one mixture"
        layers = ", ".join(map(str, self.layers))
        tried = "; ".join(trial.as_text() for trial in self.trials)
        return (f"strategy {self.chosen.way} chosen on layers {layers}, dead times "
                f"{self.dead_time_error_s:g} s off at worst: {tried}")


def with_chosen_strategy(
    part: Part, profile: MachineProfile
) -> tuple[Part, StrategyChoice | None]:
    """The part with a strategy in place of "auto", and the choice; None where it names its own."""
    if part.process.strategy != "auto":
        return part, None
    choice = choose_strategy(part, profile)
    return _planned_with(part, choice.chosen.strategy, choice.chosen.change_margin_s), choice


def choose_strategy(part: Part, profile: MachineProfile) -> StrategyChoice:
    """The fastest of the plans whose share of right mixture is about the best.

    Raises PlanError where the part cannot be planned in any way.
    """
    if part.copies:  # one of them is tried
        part = replace(part, copies=())
    process = part.process
    margin, error_s = process.change_margin_s, process.dead_time_error_s
    if part.uniform_mixture() is not None:
        only = StrategyTrial("offset", margin, 1.0, 1.0, 0.0, 0, 1.0)
        return StrategyChoice(only, (only,), (), error_s)
    ways = [("offset", margin), ("iso-composition", margin)]
    if error_s > margin and process.powder == "lead":
        ways.append(("iso-composition", error_s))
    placement = check_part(_planned_with(part, "offset", margin), profile)
    layers = sorted({min(int(at * placement.n_layers), placement.n_layers - 1)
                     for at in _TRIED_AT})
    made: dict[str, list[LayerGeometry]] = {}
    trials, failed = [], None
    for strategy, wait_s in ways:
        planned = _planned_with(part, strategy, wait_s)
        if strategy not in made:
            made[strategy] = [layer_geometry(planned, placement, layer) for layer in layers]
        try:
            trials.append(_trial(planned, profile, placement, made[strategy]))
        except PlanError as error:
            failed = error
    if not trials:
        assert failed is not None, "each way was tried"
        raise failed
    return StrategyChoice(_best(trials, process), tuple(trials),
                          tuple(layer + 1 for layer in layers), error_s)


def _best(trials: list[StrategyTrial], process: ProcessSettings) -> StrategyTrial:
    whole = [trial for trial in trials if trial.built >= process.min_built_fraction] or trials
    reached = max(min(trial.right, trial.right_at_worst) for trial in whole)
    good = [trial for trial in whole
            if min(trial.right, trial.right_at_worst) >= reached - _AS_GOOD]
    return min(good, key=lambda trial: (trial.time_s, trial.starts))


def _planned_with(part: Part, strategy: str, change_margin_s: float) -> Part:
    return replace(part, process=part.process.model_copy(
        update={"strategy": strategy, "change_margin_s": change_margin_s}))


def _trial(
    part: Part, profile: MachineProfile, placement: Placement, made: list[LayerGeometry]
) -> StrategyTrial:
    recipe = recipe_of(part, profile, placement.layer_height_mm)
    sequencer = LayerSequencer(
        part.name, part.process, recipe, profile, stack=part.layer_stack,
        mixtures=None if part.alloy_rules is None else part.laid_mixtures)
    made = [geometry for geometry in made if geometry.n_tracks]
    errors = [0.0]
    if part.process.powder == "lead":
        errors += [part.process.dead_time_error_s, -part.process.dead_time_error_s]
    right, length = np.zeros(len(errors)), 0.0
    for index, geometry in enumerate(made):
        lines = sequencer.sequence(index, geometry, placement, is_last=False)
        z_mm = geometry.z_mm
        along_mm, off = _mixture_errors(part, recipe, lines, placement, z_mm, errors)
        right += (along_mm * (off <= MIXTURE_TOLERANCE_FRACTION + 1e-9)).sum(axis=1)
        length += float(along_mm.sum())
    sequencer.finish()
    slice_mm2 = sum(geometry.figures.slice_mm2 for geometry in made)
    share = right / max(length, 1e-9)
    return StrategyTrial(
        part.process.strategy, part.process.change_margin_s,
        min(float(share[0]), sequencer.statistics.correct_mixture_fraction), float(share.min()),
        sequencer.duration_s, sequencer.statistics.contours,
        sum(geometry.figures.inside_mm2 for geometry in made) / max(slice_mm2, 1e-9))


def _mixture_errors(
    part: Part, recipe: Recipe, lines: LayerLines, placement: Placement, z_mm: float,
    dead_time_errors_s: list[float],
) -> tuple[FloatArray, FloatArray]:
    """Lengths (q,) of a layer's beads, and how far the mixture is off there, (errors, q)."""
    moves, end_s = lines.moves, lines.end_s
    bead = np.flatnonzero(moves.kind == LineKind.BEAD)
    begin_s = end_s[bead - 1]
    lasting_s = end_s[bead] - begin_s
    pieces = np.maximum(1, np.ceil(lasting_s / _EVERY_S).astype(np.intp))
    line = np.repeat(np.arange(len(bead)), pieces)
    share = (indices_within_stretches(pieces) + 0.5) / pieces[line]
    start, end = moves.target_mm[bead - 1, :2], moves.target_mm[bead, :2]
    at_mm = start[line] + share[:, None] * (end - start)[line] - placement.offset_mm[:2]
    designed = part.composition(np.column_stack([at_mm, np.full(len(at_mm), z_mm)]))
    at_s = begin_s[line] + share * lasting_s[line]
    off = []
    for error_s in dead_time_errors_s:
        flow = np.column_stack([np.interp(at_s - error_s, lines.flow.times_s, column)
                                for column in lines.flow.g_s.T])
        off.append(np.abs(recipe.deposited_fractions(flow) - designed).max(axis=1))
    length = np.linalg.norm(end - start, axis=1)[line] / pieces[line]
    return length, np.array(off)
