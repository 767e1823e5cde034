"""Live process values of a run as JSON, each with its origin and age."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from lmctl.run.cell.devices import ReportAges
from lmctl.run.journal.recorder import LatestReport


class ValueOrigin(NamedTuple):
    """Where a value comes from.

    kind : "planned" (the job), "commanded" (sent to a device), "reported" (by a device)
    source : the device or file, in words
    age_s : since it was reported, None for a value that does not age
    """

    kind: str
    source: str
    age_s: float | None = None

    def as_json(self) -> dict[str, Any]:
        age_s = None if self.age_s is None else round(self.age_s, 3)
        return {"kind": self.kind, "source": self.source, "age_s": age_s}


def live_values(
    latest: LatestReport | None, hoppers: Sequence[str], power_W_per_s: float
) -> dict[str, Any]:
    """Values of the last report, None before the first; flows in the hoppers' order.

    power_W_per_s : beam power of one S word
    """
    if latest is None:
        return dict.fromkeys((
            "position_mm", "s_word", "power_W", "speed_mm_s", "set_g_min", "measured_g_min",
            "carrier_L_min", "shield_gas_L_min"))
    return {
        "position_mm": list(latest.position_mm), "s_word": latest.s_word,
        "power_W": None if latest.s_word is None else round(latest.s_word * power_W_per_s, 2),
        "speed_mm_s": None if latest.feed_mm_min is None else round(latest.feed_mm_min / 60.0, 3),
        "set_g_min": list(latest.set_g_min), "measured_g_min": list(latest.measured_g_min),
        "carrier_L_min": list(latest.carrier_L_min) or [None] * len(hoppers),
        "shield_gas_L_min": latest.shield_gas_L_min,
    }


def value_origins(
    latest: LatestReport | None, now_s: float, ages: ReportAges
) -> dict[str, dict[str, Any]]:
    """{key of a status: its origin}, of the keys that change while a run goes on."""
    motion_s = ages.motion_s if latest is None else now_s - latest.at_s
    hoppers_s = max(ages.hoppers.values(), default=None)
    controller = ValueOrigin("reported", "motion controller", motion_s)
    feeder = ValueOrigin("reported", "feeders", hoppers_s)
    origins = {
        **dict.fromkeys(("position_mm", "s_word", "power_W", "speed_mm_s", "line"), controller),
        **dict.fromkeys(("measured_g_min", "carrier_L_min", "levels"), feeder),
        "shield_gas_L_min": ValueOrigin("reported", "safety-input device", ages.safety_s),
        "set_g_min": ValueOrigin("commanded", "set-points sent to the feeders"),
        "sent_line": ValueOrigin("commanded", "lines sent to the motion controller"),
        "override_percent": ValueOrigin("commanded", "the operator"),
        "total_s": ValueOrigin("planned", "the job"),
        "remaining_s": ValueOrigin("planned", "the job, from the place reported"),
    }
    return {name: origin.as_json() for name, origin in origins.items()}
