"""The mixture at the nozzle, inferred from set-points and from what feeders report of their discs.

Set-points give the shape of a flow, since they are journaled as they change, and a feeder reports a
hopper only once in a few seconds. A report that fits none of the set-points shortly before it
scales the flow from there on: on a healthy cell the scale is 1. Between disc and nozzle lie a dead
time and a first-order lag, those that the run was made with. What each powder adds to the deposit
is its flow times catch efficiency over density. Nobody measures any of this at the nozzle: the
result is inferred, and right as far as those values are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray

#: Flows of all powders below this are no mixture [mm³/s].
_NO_VOLUME_MM3_S = 1e-6

#: A report is as old as this at most, the disc's way to its set-point included [s].
_REPORT_AGE_S = 5.5


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

    def __init__(
        self, hoses: tuple[HoseValues, ...], n_materials: int,
        deposited: Callable[[FloatArray, FloatArray], FloatArray] = lambda alone, _: alone,
    ) -> None:
        """deposited : volumes (n, materials) from those of powders fed alone, and what is fed"""
        self._hoses = hoses
        self._deposited = deposited
        self._n_materials = n_materials
        self._order_s = [-math.inf]
        self._orders_g_min: list[tuple[float, ...]] = [(0.0,) * len(hoses)]
        self._scale_s = np.array([-math.inf])
        self._scales = np.ones((1, len(hoses)))
        self._at_nozzle = [0.0] * len(hoses)
        self._last_s = 0.0

    def order_flows(self, t_s: float, flows_g_min: dict[str, float]) -> None:
        """From t on the discs are asked to feed so much."""
        before = self._orders_g_min[-1]
        self._order_s.append(t_s)
        self._orders_g_min.append(tuple(
            float(flows_g_min.get(hose.name, old))
            for hose, old in zip(self._hoses, before, strict=True)))

    def take_hose_response(self, record: dict[str, Any]) -> None:
        """A purge has measured a hose, or nothing: later samples are behind it as it is then used.

        Samples before it have been advanced over.
        """
        if record["source"] == "measured":
            self._hoses = tuple(
                replace(hose, dead_time_s=float(record["used_dead_time_s"]),
                        lag_s=float(record["used_lag_s"]))
                if hose.name == record["hopper"] else hose for hose in self._hoses)

    def advance(self, at_s: FloatArray, reported_g_min: FloatArray) -> FloatArray:
        """Mixtures at the next samples.

        at_s : (n,) rising [s]; reported_g_min : (n, hoppers), NaN where a feeder reported none
        returns : (n, materials) volume fractions; NaN where flows are too small for a mixture
        """
        order_s, orders = np.array(self._order_s), np.array(self._orders_g_min)
        self._scale_s = np.concatenate([self._scale_s, at_s])
        self._scales = np.concatenate([
            self._scales, _scales(at_s, reported_g_min, order_s, orders)])
        volume = np.zeros((len(at_s), self._n_materials))
        fed = np.zeros_like(volume)
        for column, hose in enumerate(self._hoses):
            flow = self._behind_the_hose(column, at_s, order_s, orders[:, column])
            fed[:, hose.material] += flow
            volume[:, hose.material] += flow / 60.0 * hose.deposit_mm3_g
        volume = self._deposited(volume, fed)
        self._last_s = float(at_s[-1])
        self._forget()
        total = volume.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(volume, total, out=np.full_like(volume, np.nan),
                                    where=total > _NO_VOLUME_MM3_S))

    def _behind_the_hose(
        self, column: int, at_s: FloatArray, order_s: FloatArray, orders: FloatArray
    ) -> FloatArray:
        """One flow behind its dead time and its lag: exact for set-points that are held."""
        hose = self._hoses[column]
        arrive_s = order_s + hose.dead_time_s
        between = arrive_s[(arrive_s > self._last_s) & (arrive_s < at_s[-1])]
        grid_s = np.union1d(at_s, between)
        left_s = (np.append(self._last_s, grid_s[:-1]) + grid_s) / 2.0 - hose.dead_time_s
        scale = self._scales[np.searchsorted(self._scale_s, left_s, side="right") - 1, column]
        wanted = orders[np.searchsorted(order_s, left_s, side="right") - 1] * scale
        lasting_s = np.diff(grid_s, prepend=self._last_s)
        stays = np.exp(-lasting_s / hose.lag_s) if hose.lag_s > 0.0 else np.zeros(len(grid_s))
        flow, found = self._at_nozzle[column], []
        for held, share in zip(wanted.tolist(), stays.tolist(), strict=True):
            flow = held + (flow - held) * share
            found.append(flow)
        self._at_nozzle[column] = flow
        return np.array(found)[np.searchsorted(grid_s, at_s)]

    def _forget(self) -> None:
        """Drop what no later sample needs."""
        longest_s = max((hose.dead_time_s for hose in self._hoses), default=0.0)
        since_s = self._last_s - max(longest_s, _REPORT_AGE_S)
        keep = max(0, int(np.searchsorted(self._order_s, since_s)) - 1)
        del self._order_s[:keep], self._orders_g_min[:keep]
        keep = max(0, int(np.searchsorted(self._scale_s, since_s)) - 1)
        self._scale_s, self._scales = self._scale_s[keep:], self._scales[keep:]


def _scales(
    at_s: FloatArray, reported: FloatArray, order_s: FloatArray, orders: FloatArray
) -> FloatArray:
    """Reported flow over the nearest one ordered within the age of a report, (n, hoppers)."""
    first = np.maximum(0, np.searchsorted(order_s, at_s - _REPORT_AGE_S, side="right") - 1)
    behind = np.searchsorted(order_s, at_s, side="right")
    spans = np.column_stack([first, behind]).ravel()
    padded = np.vstack([orders, orders[-1:]])
    least = np.minimum.reduceat(padded, spans)[::2]
    most = np.maximum.reduceat(padded, spans)[::2]
    nearest = np.clip(reported, least, most)
    known = np.isfinite(reported) & (nearest > 0.0)
    return np.asarray(np.divide(reported, nearest, out=np.ones_like(reported), where=known))
