"""From a part to a job, a layer at a time: the road every bead takes through planning.

section → tracks → composition → order → beads → moves → times → powder → text → job
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import lmctl
from lmctl.config.machine import MachineProfile
from lmctl.job.manifest_json import part_digest
from lmctl.job.schema import HopperUse, JobManifest
from lmctl.job.writer import JobWriter
from lmctl.plan.layer_planner import LayerPlanner
from lmctl.plan.layer_range import place_layers
from lmctl.plan.verdict import verdict
from lmctl.preflight.job_check import check_job
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part


def plan_job(
    part: Part, profile: MachineProfile, out: Path,
    progress: Callable[[int, int], None] | None = None,
) -> JobManifest:
    """Plan a part and write the job file; whole or, on any exception, not at all.

    progress : called with (layers done, layers in all)
    Raises PlanError where the part cannot be planned as asked, JobError where the file cannot be
    written.
    """
    placement = place_layers(part, profile)
    planner = LayerPlanner(part, profile, placement)
    with JobWriter(out) as job:
        for layer in range(placement.n_layers):
            job.add_layer(planner.layer(layer))
            if progress is not None:
                progress(layer + 1, placement.n_layers)
        manifest = _manifest(part, profile, placement, planner)
        check_job(manifest, profile)
        return job.finish(manifest, part.text)


def _manifest(
    part: Part, profile: MachineProfile, placement: Placement, planner: LayerPlanner
) -> JobManifest:
    """The manifest of all layers planned, without its layer table."""
    tally = planner.tally
    findings = verdict(tally, placement, part.process.powder)
    warnings = [*part.warnings, *(f["text"] for f in findings if f["level"] == "warning")]
    low, high = tally.low_mm.tolist(), tally.high_mm.tolist()
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
            HopperUse(h.name, h.material, h.dead_time_s, h.lag_s, h.max_flow_g_min)
            for h in planner.recipe.hoppers),
        bounds_mm=((low[0], low[1], low[2]), (high[0], high[1], high[2])),
        totals=tally.totals(planner.duration_s, warnings),
        verdict=tuple(findings),
    )
