"""From a part to a job: geometry of each layer, layers in sequence, text of each layer.

```text
part ──> GEOMETRY (layer)  ──> SEQUENCE (layers in order)  ──> TEXT (layer) ──> job
         pure, parallel        one pass, carries state         pure, parallel
```
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import lmctl
from lmctl.config.machine import MachineProfile
from lmctl.errors import PlanError
from lmctl.job.manifest_json import part_digest
from lmctl.job.schema import JobHopper, JobManifest
from lmctl.job.writer import JobWriter
from lmctl.part.copies import composition_of_copies
from lmctl.part.named_bodies import NO_NAMED_BODIES
from lmctl.part.substrate import flattened_part
from lmctl.plan.completeness import Completeness
from lmctl.plan.copy_order import copies_totals, layers_in_order, times_deposited
from lmctl.plan.dilution import compensation_of, with_known_dilution
from lmctl.plan.execution import LocalWorkers, StageWorkers, ordered_results
from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.heat import heat_findings, heat_planner_of, heat_totals
from lmctl.plan.layer_range import nothing_to_deposit
from lmctl.plan.margins.margin_findings import is_enough, margin_findings
from lmctl.plan.margins.mixture_margins import mixture_margins
from lmctl.plan.margins.other_strategy import (
    StrategyMargins,
    dilution_half_width,
    iso_composition_margins,
)
from lmctl.plan.plan_report import Finding, plan_report, report_finding
from lmctl.plan.program_text import LayerLines
from lmctl.plan.recipe import recipe_of
from lmctl.plan.sequence.layer_sequencer import LayerSequencer
from lmctl.plan.strategy_choice import StrategyChoice, with_chosen_strategy
from lmctl.plan.substrate_report import substrate_report, substrate_totals
from lmctl.preflight.job_check import check_limits
from lmctl.preflight.part_check import check_part

if TYPE_CHECKING:
    from lmctl.part.part import Part


@dataclass(frozen=True)
class PlanOptions:
    """How a part is planned; none of it changes where a bead lies.

    jobs : processes for the stages that can run in parallel
    cluster : opens workers elsewhere for these stages, instead of processes
    layers : plan only these layers of the job, from the first number to the last, from 1; for
        inspection only: no machine accepts such a job
    allow_incomplete : also where a part of the part is not deposited
    allow_overhang : also where walls lean out too far, or material starts in the air
    """

    jobs: int = 1
    cluster: Callable[[Part], StageWorkers] | None = None
    layers: tuple[int, int] | None = None
    allow_incomplete: bool = False
    allow_overhang: bool = False

    def open_workers(self, part: Part) -> StageWorkers:
        """Workers for the pure stages. Raises PlanError where a cluster cannot be reached."""
        return self.cluster(part) if self.cluster else LocalWorkers(part, self.jobs)


def plan_job(
    part: Part, profile: MachineProfile, out: Path,
    progress: Callable[[int, int], None] | None = None, options: PlanOptions | None = None,
) -> JobManifest:
    """Plan a part and write the job file; whole or, on any exception, not at all.

    progress : called with (layers done, layers in all)
    The job is the same, byte for byte, wherever its layers are made.
    Raises PlanError where the part cannot be planned so, or the plan is not the part;
    JobError where the file cannot be written.
    """
    options = options or PlanOptions()
    part = flattened_part(with_known_dilution(part, profile))
    part, choice = with_chosen_strategy(
        part if part.alloy_rules is None else part.as_laid(), profile)
    planning = _Planning(part, profile, options, choice)
    with JobWriter(out) as job, options.open_workers(part) as workers:
        for layer in ordered_results(workers.text, planning.sequenced(workers), workers.window):
            job.add_packed_layer(layer)
            if progress is not None:
                progress(layer.entry.index + 1, planning.count())
        manifest = planning.manifest()
        check_limits(manifest, profile)
        return job.finish(manifest, part.text)


class _Planning:
    """One part on its way through geometry and sequence."""

    def __init__(
        self, part: Part, profile: MachineProfile, options: PlanOptions,
        choice: StrategyChoice | None,
    ) -> None:
        self._choice = choice
        self._whole_placement = self._placement = check_part(part, profile)
        self._lowest = self._first = 0
        self._last = self._whole_placement.n_layers - 1
        self._part = part
        self._profile = profile
        self._options = options
        self._recipe = recipe_of(part, profile, self._whole_placement.layer_height_mm)
        self._dilution = compensation_of(part, profile, self._recipe)
        self._heat = heat_planner_of(part, self._recipe, self._whole_placement,
                                     is_excerpt=options.layers is not None)
        self._sequencer = LayerSequencer(
            part.name, part.process, self._recipe, profile, self._dilution, part.layer_stack,
            None if part.alloy_rules is None else part.laid_mixtures, self._heat)
        # places in several copies are none of the bodies' own
        self._named_bodies = NO_NAMED_BODIES if part.copies else part.named_bodies
        self._completeness = Completeness(
            part.process, self._whole_placement.layer_height_mm,
            self._whole_placement.uncovered_height_mm(), part.named_bodies)

    def count(self) -> int:
        """Layers of the job, as far as is known: those above the last with tracks come off last."""
        return (self._last - self._first + 1) * times_deposited(self._part)

    def sequenced(self, workers: StageWorkers) -> Iterator[LayerLines]:
        """The layers of the job in order. Raises PlanError where there are none to plan."""
        set_down = self._part.placement_mm is None and self._part.layer_stack is None
        index = -1
        in_order = layers_in_order(
            _first_to_last_with_tracks(self._geometries(workers)), self._part)
        for geometry, is_last, is_next_copy in in_order:
            if index < 0 and self._options.layers is None:
                self._lowest = self._first = geometry.layer
                self._refuse_above_substrate(geometry.layer)
            if is_last:
                self._last = geometry.layer
            index += 1
            self._placement = self._whole_placement.restricted_to_layers(
                self._lowest, self._whole_placement.n_layers - 1, set_down=set_down)
            yield self._sequencer.sequence(index, geometry, self._placement, is_last=is_last,
                                           clears_all=is_next_copy)
        if index < 0:
            raise nothing_to_deposit(self._part)
        if self._options.layers is None:
            self._placement = self._whole_placement.restricted_to_layers(self._first, self._last,
                                                               set_down=set_down)

    def _refuse_above_substrate(self, first: int) -> None:
        """Raise PlanError where nothing is deposited on the substrate itself."""
        if self._part.layer_stack is None or first == 0:
            return
        raise PlanError(
            f"nothing of {self._part.name} is deposited on its substrate: the lowest layer with "
            f"tracks is layer {first + 1}",
            where=f"{first * self._whole_placement.layer_height_mm:.2f} mm above the substrate",
            hint="check the heights of both: they are in the part file's coordinates")

    def _geometries(self, workers: StageWorkers) -> Iterator[LayerGeometry]:
        """Geometry of every layer of the part, or of those to look at, in order."""
        if self._options.layers is not None:
            self._choose_layers(workers, *self._options.layers)
        for geometry in ordered_results(
            lambda layer: workers.geometry(self._whole_placement, layer),
            range(self._first, self._last + 1), workers.window,
        ):
            self._completeness.add_layer(geometry)
            yield geometry

    def _choose_layers(self, workers: StageWorkers, first: int, last: int) -> None:
        """The layers numbered from the first with tracks, which is 1."""
        for layer in range(self._whole_placement.n_layers):
            self._lowest = layer
            if workers.geometry(self._whole_placement, layer).result().n_tracks:
                break
        self._first = self._lowest + first - 1
        self._last = min(self._lowest + last, self._whole_placement.n_layers) - 1
        if self._first > self._last:
            count = self._whole_placement.n_layers - self._lowest
            raise PlanError(f"{self._part.name} has no layer {first}",
                            hint=f"layers go from 1 to {count}")

    def _completeness_findings(self) -> Iterator[Finding]:
        """Whether the plan is the part. Raises PlanError where it is not, and may not be."""
        options, completeness = self._options, self._completeness
        if options.layers is not None:
            yield report_finding(False,
                                 "only layers {} to {} are planned, for looking: no machine takes "
                                 "this job".format(*options.layers))
            return
        completeness.check(allow_incomplete=options.allow_incomplete,
                           allow_overhang=options.allow_overhang)
        if not completeness.is_complete():
            yield report_finding(False,
                                 "this job is not the whole part: planned with --allow-incomplete")
        if completeness.steep_overhangs():
            yield report_finding(False,
                                 "walls lean out beyond the limit, or material starts in the air: "
                                 "planned with --allow-overhang")
        yield from (report_finding(*found) for found in completeness.findings())

    def _dilution_findings(self) -> Iterator[Finding]:
        if self._dilution is None:
            return
        if not self._dilution.knows_substrate:
            yield report_finding(
                False, "the first layer does not make up for dilution: the part file does not say "
                "what the substrate is of ([substrate] material)")
        yield from (report_finding(*found) for found in
                    self._sequencer.dilution_statistics.findings(self._named_bodies))

    def _other_margins(self) -> StrategyMargins | None:
        """The margins of another strategy, tried on one part."""
        if not self._part.copies:
            return iso_composition_margins(self._part, self._profile, self._whole_placement)
        one = replace(self._part, copies=())
        return iso_composition_margins(one, self._profile, check_part(one, self._profile))

    def manifest(self) -> JobManifest:
        """The manifest of all layers planned, without its layer table.

        Raises PlanError where the plan is not the part, and that is not allowed.
        """
        part, profile, statistics = self._part, self._profile, self._sequencer.statistics
        rules = self._sequencer.alloy_statistics
        excerpt, used = self._options.layers, profile.calibration_use
        margins = None if part.uniform_mixture() is not None else mixture_margins(
            self._sequencer.samples, self._recipe, used, composition_of_copies(part),
            statistics.correct_mixture_fraction,
            0.0 if self._dilution is None else dilution_half_width(profile))
        other = None if margins is None or is_enough(margins) else self._other_margins()
        findings = [
            *([] if self._choice is None else [report_finding(True, self._choice.as_text())]),
            *self._completeness_findings(),
            *plan_report(statistics, self._placement, part.process.powder),
            *heat_findings(self._heat, part.process, is_excerpt=self._options.layers is not None),
            *([] if rules is None else rules.findings()), *self._dilution_findings(),
            *substrate_report(part, profile.nozzle is not None),
            *(report_finding(*found)
              for found in (() if margins is None else margin_findings(margins, other)))]
        warnings = [*part.warnings, *(f["text"] for f in findings if f["level"] == "warning")]
        x, y, z = self._placement.offset_mm
        low, high = statistics.low_mm.tolist(), statistics.high_mm.tolist()
        return JobManifest(
            part_name=part.name,
            part_sha256=part_digest(part.text),
            sources=dict(part.sources),
            machine=profile.name,
            profile_digest=profile.planning_digest(),
            software=f"lmctl {lmctl.__version__}",
            powder_mode=part.process.powder,
            s_max=profile.laser.s_max,
            max_power_W=profile.laser.max_power_W,
            send_horizon_s=profile.motion.send_horizon_s,
            materials=tuple(material.name for material in part.materials),
            hoppers=tuple(
                JobHopper(h.name, h.material, h.dead_time_s, h.lag_s, h.max_flow_g_min,
                          h.min_flow_g_min, h.slope, h.offset_g_min)
                for h in self._recipe.hoppers),
            bounds_mm=((low[0], low[1], low[2]), (high[0], high[1], high[2])),
            totals=statistics.totals(self._sequencer.duration_s, warnings)
            | self._completeness.totals()
            | {"strategy": part.process.strategy}
            | ({} if self._dilution is None else {
                "dilution": self._sequencer.dilution_statistics.totals(self._named_bodies)})
            | ({} if margins is None else {"margins": margins.as_json() | (
                {} if other is None else {"other_strategy": other.as_json()})})
            | substrate_totals(part)
            | ({} if part.process.height_check_every is None else
               {"height_check_every": part.process.height_check_every,
                "height_tolerance_mm": part.process.height_tolerance_mm})
            | copies_totals(part, self._placement)
            | ({} if rules is None else rules.totals())
            | heat_totals(self._heat)
            | ({} if part.surface_error_mm is None else
               {"surface_error_mm": round(part.surface_error_mm, 4)}),
            verdict=tuple(findings),
            part_offset_mm=(float(x), float(y), float(z)),
            excerpt=excerpt,
            mixtures=tuple(statistics.mixtures),
            heat=() if self._heat is None else tuple(self._heat.layers),
            calibration=None if used is None else used.as_json(),
        )


def _first_to_last_with_tracks(
    geometries: Iterable[LayerGeometry],
) -> Iterator[tuple[LayerGeometry, bool]]:
    """The layers from the first with tracks to the last, and whether each is that last one."""
    held: list[LayerGeometry] = []  # the last with tracks so far, and those without above it
    for geometry in geometries:
        if geometry.n_tracks == 0:
            if held:
                held.append(geometry)
            continue
        yield from ((layer, False) for layer in held)
        held = [geometry]
    if held:
        yield held[0], True
