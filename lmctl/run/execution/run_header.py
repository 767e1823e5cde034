"""The first record of a run's journal: what the run is, and which run it continues."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from lmctl import __version__
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.job.margins_text import margins_text
from lmctl.job.reader import JobReader
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.journal.recorder import wall_stamp


def run_header(
    job: JobReader, profile: MachineProfile, hoppers: Sequence[HopperSettings], operator: str,
    continues: EarlierRun | None,
) -> dict[str, Any]:
    """Job, machine, software, operator, hoppers: equal for equal runs."""
    manifest, used = job.manifest, profile.calibration_use
    heat = manifest.totals.get("predicted_heat")
    return {
        "job": job.digest, "part": manifest.part_name, "part_sha256": manifest.part_sha256,
        "sources": manifest.sources, "software": f"lmctl {__version__}",
        "planned_with": manifest.software, "machine": profile.name,
        "profile": profile.planning_digest(), "operator": operator,
        "powder_mode": manifest.powder_mode, "layers": len(manifest.layers),
        "lines": sum(entry.n_lines for entry in manifest.layers),
        **({} if continues is None else _earlier_run(continues)),
        "planned_s": manifest.layers[-1].end_s, "materials": list(manifest.materials),
        **({"mixture": mixture} if (mixture := margins_text(manifest.totals)) else {}),
        **({"copies": [str(one["name"]) for one in copies]}
           if (copies := manifest.totals.get("copies")) else {}),
        "warnings": list(manifest.totals.get("warnings", [])),
        **({"predicted_heat": heat} if heat is not None else {}),
        "hoppers": [
            {"name": h.name, "feeder": h.feeder, "material": h.material,
             "dead_time_s": h.dead_time_s, "lag_s": h.lag_s,
             **({} if used is None else {"slope": h.slope, "offset_g_min": h.offset_g_min,
                                         "catch_efficiency": h.catch_efficiency})}
            for h in hoppers
        ],
        **({} if used is None else {"calibration": used.as_json()}),
        **({} if not profile.mixture_catch else {
            "mixture_catch": [one.model_dump(mode="json") for one in profile.mixture_catch]}),
        **({} if not manifest.totals.get("alloy_rules") else {
            "alloy_rules": [_alloy_rule(rule) for rule in manifest.totals["alloy_rules"]]}),
    }


def local_header(run: str, profile: MachineProfile) -> dict[str, Any]:
    """What differs between equal runs."""
    endpoints = {feeder.name: feeder.endpoint for feeder in profile.feeder}
    return {"run": run, "wall": wall_stamp(), "uid": os.getuid(), "pid": os.getpid(),
            "endpoints": {"motion": profile.motion.endpoint, **endpoints}}


def _alloy_rule(rule: dict[str, Any]) -> dict[str, Any]:
    """A rule of the job's totals without the mixtures of its ways round."""
    return {key: rule.get(key) for key in ("name", "reason", "changed_mm", "changed_by")}


def _earlier_run(continues: EarlierRun) -> dict[str, Any]:
    """Fields that a later run needs again if this run fails before it enters the part."""
    place, standstill_mm = continues.reached.place, continues.standstill_mm
    return {"continues": continues.run, "position_kept": continues.is_position_trusted,
            "begins_at": {"line": place.line, "share": round(place.line_fraction, 6),
                          "known": continues.reached.known},
            "standstill_mm": standstill_mm and [round(axis, 3) for axis in standstill_mm]}
