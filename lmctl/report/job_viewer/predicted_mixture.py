"""The mixture at the nozzle that a job is predicted to have, as its plan predicted it.

Set-points are those that running will send: held from tick to tick, rounded, within a slack, and
turned into what hoppers feed by the calibration that the job was planned with
(`lmctl.plan.sequence.held_setpoints`, `lmctl.plan.sequence.nozzle_flow`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobLayer, JobManifest
from lmctl.plan.sequence.held_setpoints import HeldSetpoints
from lmctl.plan.sequence.nozzle_flow import CellValues, nozzle_flow_g_s
from lmctl.report.reported_values import PartScales


class MixturePredictor:
    """Predicts the layers of one job.

    scales : of the job's part; without catch and density of every powder nothing is predicted
    """

    def __init__(self, manifest: JobManifest, scales: PartScales) -> None:
        hoppers = manifest.hoppers
        self._materials = [one.material for one in hoppers]
        self._scales = scales
        self._setpoints = HeldSetpoints(hoppers, leads=manifest.powder_mode == "lead")
        self._values = CellValues.believed(hoppers, np.ones(len(hoppers)))
        self._kept_s = 2.0 * self._values.settling_s()

    def predict(
        self, layers: Iterable[JobLayer]
    ) -> Iterator[tuple[JobLayer, FloatArray | None]]:
        """All layers in order, each with volume fractions (lines, materials) at the end of its
        lines, None where they are not known.

        The last set-points of a layer depend on the next, so a few layers are in memory at a time.
        """
        if not set(self._materials) <= self._scales.deposit_mm3_g.keys():
            yield from ((layer, None) for layer in layers)
            return
        waiting: deque[JobLayer] = deque()
        for layer in layers:
            waiting.append(layer)
            self._setpoints.add_flow(layer.flow_s, layer.flow_g_s)
            yield from self._predicted(waiting)
        self._setpoints.finish()
        yield from self._predicted(waiting)

    def _predicted(
        self, waiting: deque[JobLayer]
    ) -> Iterator[tuple[JobLayer, FloatArray]]:
        while waiting and waiting[0].flow_s[-1] <= self._setpoints.known_until_s:
            layer = waiting.popleft()
            at_s = np.clip(layer.lines["end_s"], layer.flow_s[0], layer.flow_s[-1])
            begin_s = float(layer.flow_s[0]) - self._kept_s
            self._setpoints.forget_before(begin_s)
            changes = self._setpoints.changes_since(begin_s).until(float(layer.flow_s[-1]))
            flow_g_s = nozzle_flow_g_s(changes, self._values, at_s)
            yield layer, np.nan_to_num(self._scales.fractions(flow_g_s, self._materials))
