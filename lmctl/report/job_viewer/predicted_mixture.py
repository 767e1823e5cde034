"""The mixture that a job is predicted to deposit, by the plan's own powder model."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobLayer, JobManifest
from lmctl.plan.sequence.hose_model import HoseModel
from lmctl.report.reported_values import PartScales


class MixturePredictor:
    """Goes through the layers of a job in order.

    scales : of the job's part; without catch and density of every powder nothing is predicted
    """

    def __init__(self, manifest: JobManifest, scales: PartScales) -> None:
        hoppers = manifest.hoppers
        self._materials = [manifest.materials.index(one.material) for one in hoppers]
        self._n_materials = len(manifest.materials)
        self._scales = scales
        self._deposit_mm3_g = np.array([
            scales.deposit_mm3_g.get(one.material, np.nan) for one in hoppers])
        self._hoses = HoseModel(
            np.array([one.dead_time_s for one in hoppers]),
            np.array([one.lag_s for one in hoppers]),
            np.array([one.max_flow_g_min / 60.0 for one in hoppers]),
            leads=manifest.powder_mode == "lead")

    def at_line_ends(self, layer: JobLayer) -> FloatArray | None:
        """Volume fractions (lines, materials) at the end of each line, None where not known."""
        if np.isnan(self._deposit_mm3_g).any():
            return None
        end_s = np.clip(layer.lines["end_s"], layer.flow_s[0], layer.flow_s[-1])
        flow = self._hoses.advance(layer.flow_s, layer.flow_g_s, end_s)
        volume = np.zeros((len(end_s), self._n_materials))
        fed = np.zeros_like(volume)
        for column, material in enumerate(self._materials):
            fed[:, material] += flow[:, column]
            volume[:, material] += flow[:, column] * self._deposit_mm3_g[column]
        volume = self._scales.deposited(volume, fed)
        total = volume.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(volume, total, out=np.zeros_like(volume), where=total > 0))
