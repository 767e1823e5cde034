"""Laying a coupon: planned and run like any part, and the powder it was fed with the beam on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from lmctl.calibration.coupons import Coupon
from lmctl.cli.console import print_message
from lmctl.config.machine import MachineProfile
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind


class CouponOperator(Protocol):
    """Who changes plates, weighs and cuts. Each answers with text as typed, its unit in it."""

    async def weigh_plate(self, request: str) -> str:
        """The mass of the plate, with or without its coupon, loose powder brushed off."""

    async def analyse_track(self, request: str) -> str:
        """The dilution of the last track."""


@dataclass(frozen=True)
class LaidCoupon:
    """A coupon that was deposited.

    fed_g : {material: powder that left the nozzle with the beam on}, by the job's flow
    beam_on_s : time with the beam on
    energy_J_mm : beam energy per length, mean over its beads
    run : name of its run
    """

    coupon: Coupon
    fed_g: Mapping[str, float]
    beam_on_s: float
    energy_J_mm: float
    run: str


async def lay_coupon(
    coupon: Coupon, profile: MachineProfile, runs_dir: Path, operator: str
) -> LaidCoupon:
    """Plan a coupon and run it like any job. Raises what planning and running raise."""
    from lmctl.part.load import load_part
    from lmctl.plan.planner import plan_job
    from lmctl.run.executor import run_job

    folder = runs_dir / "coupons"
    folder.mkdir(parents=True, exist_ok=True)
    part_file, job_file = folder / f"{coupon.name}.toml", folder / f"{coupon.name}.lmj"
    part_file.write_text(coupon.text, encoding="utf-8")
    plan_job(load_part(part_file), profile, job_file)
    print_message(f"laying coupon {coupon.name}")
    result = await run_job(job_file, profile, runs_dir, operator=operator, notice=print_message)
    fed_g, beam_on_s, energy_J_mm = powder_with_beam_on(job_file)
    return LaidCoupon(coupon, fed_g, beam_on_s, energy_J_mm, result.run)


def powder_with_beam_on(job_file: Path) -> tuple[dict[str, float], float, float]:
    """Powder fed by a job with its beam on {material: g}, that time [s], energy per length [J/mm].

    By the flow that the nozzle is to deliver, at the speeds of the job: without overrides.
    """
    with JobReader(job_file) as job:
        materials = [hopper.material for hopper in job.manifest.hoppers]
        fed = np.zeros(len(materials))
        beam_on_s = energy_J = length_mm = 0.0
        end_s = job.manifest.layers[0].start_s
        for layer in job.iterate_layers():
            lines = layer.lines
            begins = np.concatenate([[end_s], lines["end_s"][:-1]])
            end_s = float(lines["end_s"][-1])
            bead = lines["kind"] == LineKind.BEAD
            knots = np.unique(np.concatenate([layer.flow_s, begins[bead], lines["end_s"][bead]]))
            flow = np.column_stack([np.interp(knots, layer.flow_s, one)
                                    for one in layer.flow_g_s.T])
            pieces = np.diff(knots)[:, None] * (flow[1:] + flow[:-1]) / 2.0
            grown = np.concatenate([np.zeros((1, len(materials))), np.cumsum(pieces, axis=0)])
            ends = np.searchsorted(knots, lines["end_s"][bead])
            fed += (grown[ends] - grown[np.searchsorted(knots, begins[bead])]).sum(axis=0)
            durations = lines["end_s"][bead] - begins[bead]
            beam_on_s += float(durations.sum())
            energy_J += float((durations * lines["power_W"][bead]).sum())
            length_mm += float((durations * lines["speed_mm_s"][bead]).sum())
    return dict(zip(materials, fed.tolist(), strict=True)), beam_on_s, energy_J / length_mm
