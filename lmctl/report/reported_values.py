"""Process values of each layer as devices reported them, gathered from the samples of one journal.

Memory grows with the number of layers, not with the length of the journal.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.plan.mixture_catch import MixtureCatch
from lmctl.report.nozzle_inference import HoseValues, NozzleInference
from lmctl.report.process_values import ProcessValues
from lmctl.report.value_range import ValueRange, range_of

#: Of all powders together below this there is no mixture [mm³ of deposit a second].
_NO_VOLUME_MM3_S = 1e-6

#: So many samples are worked on at a time.
_BATCH = 4096

#: A sample stands for the time since the one before it, and for no more than this [s].
_MOST_S = 1.0


@dataclass(frozen=True)
class PartScales:
    """What turns reported numbers into process values; from the job and the part file in it.

    power_W_per_s : beam power of one S word, None where not known
    materials : names, in the part's order
    deposit_mm3_g : {material: volume that one gram fed alone adds to the deposit}; empty where not
        known
    mixture_catch : how powders fed together are caught; None: as alone
    """

    power_W_per_s: float | None = None
    materials: tuple[str, ...] = ()
    deposit_mm3_g: dict[str, float] = field(default_factory=dict)
    mixture_catch: MixtureCatch | None = None

    def deposited(self, volume_alone: FloatArray, fed: FloatArray) -> FloatArray:
        """Volumes (n, materials) that stay, of those that would if each powder were fed alone.

        fed : (n, materials) masses fed, of any unit
        """
        if self.mixture_catch is None:
            return volume_alone
        return np.asarray(volume_alone * self.mixture_catch.efficiency(fed)
                          / self.mixture_catch.alone)

    def fractions(self, flow_g_s: FloatArray, hopper_materials: Sequence[str]) -> FloatArray:
        """(n, hoppers) flows [g/s] -> (n, materials) volume fractions of the deposit.

        NaN where nothing flows, and where a powder is not known
        """
        alone = np.zeros((len(flow_g_s), len(self.materials)))
        fed = np.zeros_like(alone)
        for hopper, material in enumerate(hopper_materials):
            column = self.materials.index(material)
            fed[:, column] += flow_g_s[:, hopper]
            alone[:, column] += flow_g_s[:, hopper] * self.deposit_mm3_g.get(material, np.nan)
        volume = self.deposited(alone, fed)
        total = volume.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(volume, total, out=np.full_like(volume, np.nan),
                                    where=total > _NO_VOLUME_MM3_S))


def nozzle_of(header: dict[str, Any], scales: PartScales) -> NozzleInference | None:
    """What infers the mixture at the nozzle of a run, None where its powders are not known.

    header : the first record of its journal
    """
    hoppers = header.get("hoppers", [])
    if not all(str(one["material"]) in scales.deposit_mm3_g for one in hoppers):
        return None
    return NozzleInference(tuple(
        HoseValues(
            str(one["name"]), scales.materials.index(str(one["material"])),
            float(one["dead_time_s"]), float(one["lag_s"]),
            scales.deposit_mm3_g[str(one["material"])])
        for one in hoppers), len(scales.materials), scales.deposited)


class ReportedValueGatherer:
    """Gathers the process values of one run from its records, in order."""

    def __init__(self, scales: PartScales) -> None:
        self._scales = scales
        self._hoppers: tuple[str, ...] = ()
        self._nozzle: NozzleInference | None = None
        self._first_lines: list[int] = []
        self._layers: list[int] = []
        self._values: dict[int, ProcessValues] = {}
        self._rows: dict[str, list[Any]] = {}
        self._last_s = 0.0

    def take(self, record: dict[str, Any]) -> None:
        """Any record; those of other kinds change nothing."""
        match record["kind"]:
            case "header":
                self._take_header(record)
            case "layer_opened":
                at = bisect_right(self._first_lines, int(record["lines"][0]))
                self._first_lines.insert(at, int(record["lines"][0]))
                self._layers.insert(at, int(record["layer"]))
            case "setpoint" if self._nozzle is not None:
                self._nozzle.order_flows(float(record["t"]), record["flow_g_min"])
            case "hose_response" if self._nozzle is not None:
                self._work_off()
                self._nozzle.take_hose_response(record)
            case "samples":
                for name in ("at", "line", "feed_mm_min", "s_word"):
                    self._rows.setdefault(name, []).extend(record[name])
                count = len(record["at"])
                for kind in ("flow_g_min", "carrier_L_min"):
                    for hopper in self._hoppers:
                        column = record.get(kind, {}).get(hopper) or [None] * count
                        self._rows.setdefault(f"{kind} {hopper}", []).extend(column)
                self._rows.setdefault("shield", []).extend(
                    record.get("shield_gas_L_min") or [None] * count)
                if len(self._rows["at"]) >= _BATCH:
                    self._work_off()

    def values(self) -> dict[int, ProcessValues]:
        """{layer index: its values}, of layers that reports with the beam on fall into."""
        self._work_off()
        return dict(self._values)

    def _take_header(self, header: dict[str, Any]) -> None:
        hoppers = header.get("hoppers", [])
        self._hoppers = tuple(str(one["name"]) for one in hoppers)
        self._nozzle = nozzle_of(header, self._scales)

    def _work_off(self) -> None:
        if not self._rows.get("at"):
            return
        columns = {name: np.array(column, dtype=np.float64)  # None becomes NaN
                   for name, column in self._rows.items()}
        self._rows.clear()
        at_s = columns["at"]
        weight = np.minimum(np.diff(at_s, prepend=self._last_s), _MOST_S)
        self._last_s = float(at_s[-1])
        flows = np.stack([columns[f"flow_g_min {name}"] for name in self._hoppers], axis=1) \
            if self._hoppers else np.empty((len(at_s), 0))
        mixture = None if self._nozzle is None else self._nozzle.advance(at_s, flows)
        weight[~(columns["s_word"] > 0.0)] = 0.0
        layer_at = np.searchsorted(self._first_lines, columns["line"], side="right") - 1
        for at in np.unique(layer_at[weight > 0.0]):
            if at >= 0:
                rows = layer_at == at
                found = self._values_of(columns, mixture, weight, rows)
                layer = self._layers[at]
                self._values[layer] = self._values.get(layer, ProcessValues()).joined_with(found)

    def _values_of(
        self, columns: dict[str, FloatArray], mixture: FloatArray | None, weight: FloatArray,
        rows: BoolArray,
    ) -> ProcessValues:
        def of(values: FloatArray) -> ValueRange | None:
            return range_of(values[rows], weight[rows])

        def of_hoppers(kind: str) -> dict[str, ValueRange]:
            found = {name: of(columns[f"{kind} {name}"]) for name in self._hoppers}
            return {name: one for name, one in found.items() if one is not None}

        fractions = {} if mixture is None else {
            name: of(mixture[:, at]) for at, name in enumerate(self._scales.materials)}
        scale = self._scales.power_W_per_s
        return ProcessValues(
            of(columns["feed_mm_min"] / 60.0),
            None if scale is None else of(columns["s_word"] * scale), of(columns["shield"]),
            of_hoppers("flow_g_min"), of_hoppers("carrier_L_min"),
            {name: one for name, one in fractions.items() if one is not None})
