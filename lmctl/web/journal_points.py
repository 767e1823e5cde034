"""Curves of a live run from its journal: one point a status report, with the mixture at the nozzle.

The mixture at the nozzle is inferred by the routine that reports use, so that page and report
agree. It is unknown after a gap until the hoses hold nothing of before it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.report.nozzle_inference import NozzleInference
from lmctl.report.reported_values import nozzle_of
from lmctl.web.job_layers import JobLayers

#: Lags after which nothing of an earlier flow shows.
_LAGS_TO_SETTLE = 4.0

Points = dict[str, list[Any]]


class JournalPoints:
    """Takes the records of one run in order and returns columns of points.

    header : first record of the journal; job : None where it cannot be read
    """

    def __init__(self, header: dict[str, Any], job: JobLayers | None) -> None:
        self._header = header
        self._job = job
        hoppers = [one for one in header.get("hoppers", ()) if isinstance(one, dict)]
        self._hoppers = [str(one.get("name", "")) for one in hoppers]
        self._settling_s = max(
            (float(one.get("dead_time_s", 0.0)) + _LAGS_TO_SETTLE * float(one.get("lag_s", 0.0))
             for one in hoppers), default=0.0)
        self._scales = None if job is None else job.scales()
        self._nozzle: NozzleInference | None = None
        self._known_from_s = math.inf
        self._flows: dict[str, float] = {}
        self._hose_responses: dict[str, dict[str, Any]] = {}  # last measured, by hopper
        self.restart(at_start=True)

    def restart(self, *, at_start: bool = False) -> None:
        """Forget what is in the hoses: records were passed over. at_start : they hold no powder"""
        self._nozzle = None if self._scales is None else nozzle_of(self._header, self._scales)
        if self._nozzle is not None:
            for record in self._hose_responses.values():
                self._nozzle.take_hose_response(record)
        self._flows.clear()
        self._known_from_s = -math.inf if at_start else math.inf

    def take(self, record: dict[str, Any]) -> Points | None:
        """The points of a record of samples, None of any other. Raises for a damaged record."""
        t_s = float(record["t"])
        if record["kind"] == "setpoint":
            self._order(t_s, record["flow_g_min"])
        if record["kind"] == "hose_response" and record["source"] == "measured":
            self._hose_responses[str(record["hopper"])] = record
            if self._nozzle is not None:
                self._nozzle.take_hose_response(record)
        if record["kind"] != "samples":
            return None
        at_s = [float(one) for one in record["at"]]
        if self._known_from_s == math.inf and at_s:  # entered in the middle of a run
            self._known_from_s = at_s[0] + self._settling_s
            self._order(at_s[0], {name: record["set_g_min"][name][0] for name in self._hoppers})
        scale = None if self._scales is None else self._scales.power_W_per_s
        points: Points = {
            "at_s": at_s, "line": record["line"],
            "speed_mm_s": [None if f is None else round(f / 60.0, 3)
                           for f in record["feed_mm_min"]],
            "power_W": [None if s is None or scale is None else round(s * scale, 2)
                        for s in record["s_word"]],
            "shield_gas_L_min": record.get("shield_gas_L_min") or [None] * len(at_s),
        }
        for at, name in enumerate(self._hoppers):
            points[f"set_g_min{at}"] = record["set_g_min"][name]
            points[f"flow_g_min{at}"] = record["flow_g_min"][name]
            points[f"carrier_L_min{at}"] = record["carrier_L_min"][name]
        self._add_mixtures(points, record)
        return points

    def _order(self, t_s: float, flows_g_min: dict[str, float]) -> None:
        self._flows.update(flows_g_min)
        if self._nozzle is not None:
            self._nozzle.order_flows(t_s, self._flows)

    def _add_mixtures(self, points: Points, record: dict[str, Any]) -> None:
        """Designed, planned, commanded and inferred fractions of every material."""
        if self._job is None or self._scales is None:
            return
        planned = [self._job.planned_fractions(int(line)) for line in points["line"]]
        designed = [self._job.designed_fractions(int(line)) for line in points["line"]]
        commanded = self._scales.fractions(np.column_stack(
            [np.array(record["set_g_min"][name], dtype=np.float64) for name in self._hoppers]
        ) / 60.0, [str(one["material"]) for one in self._header["hoppers"]])
        nozzle = None
        if self._nozzle is not None and points["at_s"]:
            reported = np.column_stack([
                np.array(record["flow_g_min"][name], dtype=np.float64) for name in self._hoppers])
            nozzle = self._nozzle.advance(np.array(points["at_s"]), reported)
            nozzle[np.array(points["at_s"]) < self._known_from_s] = np.nan
        for at in range(len(self._scales.materials)):
            points[f"designed{at}"] = [None if one is None else one[at] for one in designed]
            points[f"planned{at}"] = [None if one is None else one[at] for one in planned]
            points[f"commanded{at}"] = _rounded(commanded[:, at])
            points[f"nozzle{at}"] = [None] * len(planned) if nozzle is None else _rounded(
                nozzle[:, at])


def _rounded(values: FloatArray) -> list[float | None]:
    return [round(one, 4) if math.isfinite(one) else None for one in values.tolist()]
