"""The mixture at the nozzle, inferred from the flows that feeders report of their discs.

Between disc and nozzle lie a dead time and a first-order lag, those that the run was made with.
What each powder adds to the deposit is its flow times catch efficiency over density. Nobody
measures any of this at the nozzle: the result is inferred, and right as far as those values are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray

#: Flows of all powders below this are no mixture [mm³/s].
_NO_VOLUME_MM3_S = 1e-6


@dataclass(frozen=True)
class HoseValues:
    """Of one hopper, as a run was made with. material : index among the part's materials

    deposit_mm3_g : volume that one gram fed adds to the deposit, η/ρ
    """

    name: str
    material: int
    dead_time_s: float
    lag_s: float
    deposit_mm3_g: float


class NozzleInference:
    """Follows the flows of one run, batch by batch of samples in order."""

    def __init__(self, hoses: tuple[HoseValues, ...], n_materials: int) -> None:
        self._hoses = hoses
        self._n_materials = n_materials
        self._past_s = np.empty(0)
        self._past_g_min = np.empty((0, len(hoses)))
        self._at_nozzle = np.zeros(len(hoses))
        self._late = np.zeros(len(hoses))  # flow that left the dead time last
        self._last_s = 0.0

    def advance(self, at_s: FloatArray, flow_g_min: FloatArray) -> FloatArray:
        """Mixtures at the next samples.

        at_s : (n,) rising [s]; flow_g_min : (n, hoppers), NaN where a feeder reported none
        returns : (n, materials) volume fractions; NaN where flows are not known or too small
        """
        known_s = np.concatenate([self._past_s, at_s])
        known = np.concatenate([self._past_g_min, flow_g_min])
        volume = np.zeros((len(at_s), self._n_materials))
        for column, hose in enumerate(self._hoses):
            late = np.interp(at_s - hose.dead_time_s, known_s, known[:, column])
            flow = self._lagged(column, at_s, late, hose.lag_s)
            volume[:, hose.material] += flow / 60.0 * hose.deposit_mm3_g
        self._last_s = float(at_s[-1])
        longest_s = max((hose.dead_time_s for hose in self._hoses), default=0.0)
        keep = max(0, int(np.searchsorted(known_s, self._last_s - longest_s)) - 1)
        self._past_s, self._past_g_min = known_s[keep:], known[keep:]
        total = volume.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(volume, total, out=np.full_like(volume, np.nan),
                                    where=total > _NO_VOLUME_MM3_S))

    def _lagged(self, column: int, at_s: FloatArray, late: FloatArray, lag_s: float) -> FloatArray:
        """The flow behind the lag; a hole in the reports is bridged by the flow before it."""
        result = np.empty(len(at_s))
        flow, before, last_s = self._at_nozzle[column], self._late[column], self._last_s
        for at, (t, wanted) in enumerate(zip(at_s.tolist(), late.tolist(), strict=True)):
            now = before if math.isnan(wanted) else wanted
            middle = (now + before) / 2.0
            stays = math.exp(-(t - last_s) / lag_s) if lag_s > 0.0 else 0.0
            flow = middle + (flow - middle) * stays if lag_s > 0.0 else now
            result[at] = flow
            before, last_s = now, t
        self._at_nozzle[column], self._late[column] = flow, before
        return result
