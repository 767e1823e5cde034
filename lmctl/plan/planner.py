"""From a part to a job: geometry of each layer, layers in sequence, text of each layer.

```text
part ──> GEOMETRY (layer)  ──> SEQUENCE (layers in order)  ──> TEXT (layer) ──> job
         pure, parallel        one pass, carries state         pure, parallel
```
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import lmctl
from lmctl.config.machine import MachineProfile
from lmctl.job.manifest_json import part_digest
from lmctl.job.schema import JobHopper, JobManifest
from lmctl.job.writer import JobWriter
from lmctl.plan.execution import LocalWorkers, StageWorkers, ordered_results
from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.layer_range import nothing_to_deposit
from lmctl.plan.plan_report import plan_report
from lmctl.plan.program_text import LayerLines
from lmctl.plan.recipe import make_recipe
from lmctl.plan.sequence.layer_sequencer import LayerSequencer
from lmctl.preflight.job_check import check_job
from lmctl.preflight.part_check import check_part

if TYPE_CHECKING:
    from lmctl.part.part import Part


def plan_job(
    part: Part, profile: MachineProfile, out: Path,
    progress: Callable[[int, int], None] | None = None, *,
    jobs: int = 1, cluster: Callable[[Part], StageWorkers] | None = None,
) -> JobManifest:
    """Plan a part and write the job file; whole or, on any exception, not at all.

    progress : called with (layers done, layers in all)
    jobs : processes for the stages that can run in parallel
    cluster : opens workers elsewhere for these stages, instead of processes
    The job is the same, byte for byte, wherever its layers are made.
    Raises PlanError where the part cannot be planned as asked, JobError where the file cannot be
    written.
    """
    planning = _Planning(part, profile)
    with JobWriter(out) as job, (cluster(part) if cluster else LocalWorkers(part, jobs)) as workers:
        for layer in ordered_results(workers.text, planning.sequenced(workers), workers.window):
            job.add_packed(layer)
            if progress is not None:
                progress(layer.entry.index + 1, planning.placement.n_layers)
        manifest = planning.manifest()
        check_job(manifest, profile)
        return job.finish(manifest, part.text)


class _Planning:
    """One part on its way through geometry and sequence.

    placement : of the layers planned: once the first with tracks is known without those below it,
        at the end without those above the last
    """

    def __init__(self, part: Part, profile: MachineProfile) -> None:
        self.placement = self._whole = check_part(part, profile)
        self._part = part
        self._profile = profile
        self._recipe = replace(make_recipe(part.materials, part.process, profile),
                               layer_height_mm=self._whole.layer_height_mm)
        self._sequencer = LayerSequencer(part.name, part.process, self._recipe, profile)

    def sequenced(self, workers: StageWorkers) -> Iterator[LayerLines]:
        """The layers of the job in order. Raises PlanError where none has tracks."""
        index = -1
        for geometry, is_last in _first_to_last_with_tracks(self._geometries(workers)):
            index += 1
            first = geometry.layer - index
            last = geometry.layer if is_last else self._whole.n_layers - 1
            self.placement = self._whole.restricted_to(
                first, last, set_down=self._part.placement_mm is None)
            yield self._sequencer.sequence(index, geometry, self.placement, is_last=is_last)
        if index < 0:
            raise nothing_to_deposit(self._part)

    def _geometries(self, workers: StageWorkers) -> Iterator[LayerGeometry]:
        yield from ordered_results(
            lambda layer: workers.geometry(self._whole, layer), range(self._whole.n_layers),
            workers.window)

    def manifest(self) -> JobManifest:
        """The manifest of all layers planned, without its layer table."""
        part, profile, statistics = self._part, self._profile, self._sequencer.statistics
        findings = plan_report(statistics, self.placement, part.process.powder)
        warnings = [*part.warnings, *(f["text"] for f in findings if f["level"] == "warning")]
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
                JobHopper(h.name, h.material, h.dead_time_s, h.lag_s, h.max_flow_g_min)
                for h in self._recipe.hoppers),
            bounds_mm=((low[0], low[1], low[2]), (high[0], high[1], high[2])),
            totals=statistics.totals(self._sequencer.duration_s, warnings),
            verdict=tuple(findings),
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
