"""What a job plans for one layer: path, beam time, energy, time, and powder off the discs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lmctl.run.journal.figures import ExecutionFigures
from lmctl.run.program.layer_program import LayerProgram


@dataclass(frozen=True)
class LayerPlan:
    """Of a layer layer. lines : first and last, counted through the job"""

    layer: int
    z_mm: float
    lines: tuple[int, int]
    paths: int
    figures: ExecutionFigures


def layer_plan(
    layer: LayerProgram, following: LayerProgram | None, leads_s: Mapping[str, float]
) -> LayerPlan:
    """layer : as the job has it; following : the next one, None after the last

    leads_s : {hopper: how long before the nozzle needs it its disc feeds}, in the job's order
    """
    totals = layer.planned.all_lines
    start_s, end_s = layer.starts_s[0], layer.ends_s[-1]
    beam_s = layer.planned.beam_from_s
    return LayerPlan(
        layer.index, layer.z_mm, (layer.first_line, layer.last_line), len(layer.paths),
        ExecutionFigures(
            totals.path_mm, totals.beam_s, totals.energy_J, end_s - start_s,
            {
                name: hopper_mass_g(layer, following, hopper, beam_s + lead_s, end_s + lead_s)
                for hopper, (name, lead_s) in enumerate(leads_s.items())
            },
        ),
    )


def hopper_mass_g(
    layer: LayerProgram, following: LayerProgram | None, hopper: int, from_s: float, to_s: float
) -> float:
    """Integral of a hopper's flow at the nozzle between two program times.

    hopper : index in the job's order; after the last knot the flow stays as it is
    """
    flow_s, flow_g_s = layer.flow_s, layer.flow_g_s[hopper]
    if following is not None:
        flow_s = flow_s + following.flow_s
        flow_g_s = flow_g_s + following.flow_g_s[hopper]
    inside = [s for s in flow_s if from_s < s < to_s]
    # Where two layers meet, both flows have a value at the same time: each counts on its own side.
    times = np.array([from_s, *inside, to_s])
    middle = (times[1:] + times[:-1]) / 2.0
    return float((np.interp(middle, flow_s, flow_g_s) * np.diff(times)).sum())
