"""Where the powder of a bench went, by material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulators.array_types import FloatArray
from simulators.bench_record import BeamOnPath, BenchRecord


@dataclass(frozen=True)
class PowderTotals:
    """(k,) float64 each, in the order of the path's materials.

    falloff_mm : distance over which less is caught, 0 for none
    fed_g : left the hoppers; beam_on_g, beam_off_g : left the nozzle so far
    """

    density_g_mm3: FloatArray
    falloff_mm: FloatArray
    fed_g: FloatArray
    beam_on_g: FloatArray
    beam_off_g: FloatArray


def powder_totals(record: BenchRecord, path: BeamOnPath) -> PowderTotals:
    """Add up the hoppers of each material of the path."""
    k, now_s = len(path.materials), record.now_s
    density, falloff, fed_g, nozzle_g = (np.zeros(k) for _ in range(4))
    for process in record.hopper_processes:
        row = path.materials.index(process.config.material)
        density[row] = process.config.density_g_mm3
        falloff[row] = process.config.catch_falloff_mm
        fed_g[row] += process.fed_g(now_s)
        nozzle_g[row] += process.delivered_g(now_s)
    beam_on_g = (path.flow_g_s * path.duration_s[:, None]).sum(axis=0)
    return PowderTotals(density, falloff, fed_g, beam_on_g, nozzle_g - beam_on_g)
