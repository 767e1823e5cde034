"""Process values of one layer while the beam is on: speed, power, flows, gas, mixture.

Planned, reported and inferred values have one form, and are never mixed: the field that
holds a `ProcessValues` states which kind it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmctl.job.schema import JobLayer, JobManifest, LineKind
from lmctl.report.value_range import ValueRange, joined_ranges, range_of


@dataclass(frozen=True)
class ProcessValues:
    """Ranges of quantities, each with its mean over time. What was not reported is absent.

    speed_mm_s, power_W, shield_gas_L_min : None where not known
    flow_g_min, carrier_L_min : {hopper: powder flow, carrier gas}
    fractions : {material: volume fraction in the mixture}
    """

    speed_mm_s: ValueRange | None = None
    power_W: ValueRange | None = None
    shield_gas_L_min: ValueRange | None = None
    flow_g_min: dict[str, ValueRange] = field(default_factory=dict)
    carrier_L_min: dict[str, ValueRange] = field(default_factory=dict)
    fractions: dict[str, ValueRange] = field(default_factory=dict)

    def joined_with(self, other: ProcessValues) -> ProcessValues:
        """Of both together."""
        return ProcessValues(
            _joined(self.speed_mm_s, other.speed_mm_s), _joined(self.power_W, other.power_W),
            _joined(self.shield_gas_L_min, other.shield_gas_L_min),
            joined_ranges(self.flow_g_min, other.flow_g_min),
            joined_ranges(self.carrier_L_min, other.carrier_L_min),
            joined_ranges(self.fractions, other.fractions))


def planned_process_values(layer: JobLayer, manifest: JobManifest) -> ProcessValues:
    """What a job plans for a layer: over the lines with the beam on, at an override of 100 %.

    Speeds are those programmed; flows are those wanted at the nozzle; mixtures are weighted by
    time, as the reported ones are.
    """
    lines = layer.lines
    bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
    begins_s = np.concatenate([layer.flow_s[:1], lines["end_s"][:-1]])
    lasting_s = (lines["end_s"] - begins_s)[bead]
    middle_s = (lines["end_s"] + begins_s)[bead] / 2

    def of(values: np.ndarray) -> ValueRange | None:
        return range_of(np.asarray(values, dtype=np.float64), lasting_s)

    flows = {
        hopper.name: of(60.0 * np.interp(middle_s, layer.flow_s, layer.flow_g_s[:, at]))
        for at, hopper in enumerate(manifest.hoppers)
    }
    fractions = {
        name: of(lines["fractions"][bead, at]) for at, name in enumerate(manifest.materials)
    }
    return ProcessValues(
        of(lines["speed_mm_s"][bead]), of(lines["power_W"][bead]), None,
        {name: one for name, one in flows.items() if one is not None}, {},
        {name: one for name, one in fractions.items() if one is not None})


def _joined(one: ValueRange | None, other: ValueRange | None) -> ValueRange | None:
    if one is None or other is None:
        return one or other
    return one.joined_with(other)
