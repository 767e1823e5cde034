"""Powder that a journal says was commanded, and when the model has it at the nozzle."""

from __future__ import annotations

from typing import Any

import numpy as np

from lmctl.array_types import FloatArray

_SECONDS_PER_MIN = 60.0


class CommandedPowder:
    """Set-points of a run's hoppers; give it the journal's records in order."""

    def __init__(self) -> None:
        self._hoppers: list[dict[str, Any]] = []
        self._at_s: list[float] = []
        self._set_g_min: list[dict[str, float]] = []
        self._hoses: dict[str, list[tuple[float, float, float]]] = {}

    def take(self, record: dict[str, Any]) -> None:
        """Note a header, a measured hose or a change of set-points.

        That powder is off shows in the samples.
        """
        kind = record["kind"]
        if kind == "header":
            self._hoppers = list(record["hoppers"])
            self._hoses = {hopper["name"]: [(-np.inf, float(hopper["dead_time_s"]),
                                             float(hopper["lag_s"]))] for hopper in self._hoppers}
        elif kind == "setpoint":
            self._note(float(record["t"]), record["flow_g_min"])
        elif kind == "hose_response":
            if record["source"] == "measured":
                self._hoses[record["hopper"]].append((
                    float(record["t"]), float(record["used_dead_time_s"]),
                    float(record["used_lag_s"])))
        elif kind == "samples":
            columns = record["set_g_min"]
            for row, at_s in enumerate(record["at"]):
                now = {name: float(values[row] or 0.0) for name, values in columns.items()}
                if self._is_on and not any(now.values()) and at_s > self._at_s[-1]:
                    self._note(float(at_s), now)

    @property
    def _is_on(self) -> bool:
        return bool(self._set_g_min) and any(self._set_g_min[-1].values())

    def _note(self, at_s: float, flows_g_min: dict[str, float]) -> None:
        self._at_s.append(at_s)
        self._set_g_min.append(flows_g_min)

    def flow_g_s(self, material: str, machine_s: FloatArray) -> FloatArray:
        """Flow of a material at the nozzle: each set-point θ later, through a lag τ."""
        flow = np.zeros(len(machine_s))
        for hopper in self._hoppers:
            if hopper["material"] == material and self._at_s:
                flow += self._of_hopper(hopper, machine_s)
        return flow

    def _of_hopper(self, hopper: dict[str, Any], machine_s: FloatArray) -> FloatArray:
        dead_time_s, lag_s = self._hose_at(hopper["name"], np.array(self._at_s))
        at_s = np.maximum.accumulate(np.maximum.accumulate(np.array(self._at_s)) + dead_time_s)
        wanted = np.array([one.get(hopper["name"], 0.0) for one in self._set_g_min])
        wanted = wanted / _SECONDS_PER_MIN
        kept = np.exp(-np.diff(at_s) / lag_s[:-1])
        start = np.zeros(len(at_s))
        for k in range(1, len(at_s)):
            start[k] = wanted[k - 1] + (start[k - 1] - wanted[k - 1]) * kept[k - 1]
        last = np.searchsorted(at_s, machine_s, side="right") - 1
        row = np.maximum(last, 0)
        decay = np.exp(-np.maximum(machine_s - at_s[row], 0.0) / lag_s[row])
        return np.where(last >= 0, wanted[row] + (start[row] - wanted[row]) * decay, 0.0)

    def _hose_at(self, hopper: str, set_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """θ and τ by which each set-point was led, (n,) each [s]."""
        since_s, dead_time_s, lag_s = np.array(self._hoses[hopper]).T
        row = np.searchsorted(since_s, set_s, side="right") - 1
        return dead_time_s[row], np.maximum(lag_s[row], 1e-6)
