"""The snapshot of a run: the one model that page, REST, metrics, OPC UA and MTConnect show.

It is the status that the run itself gives (`lmctl.run.status.snapshot`), with the mixture at the
nozzle, how old the answer is, and whether a process drives the run at all. Views format its values
and compute none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lmctl.run.journal.run_folders import RunFolder, RunSummary
from lmctl.run.state.transitions import FINAL_STATES

#: Keys of a run's own status that are not known once no process drives it.
_UNKNOWN = (
    "pid", "doing", "doing_left_s", "layer", "place", "override_percent", "done_s", "total_s",
    "remaining_s", "beam_off", "position_mm", "s_word", "power_W", "speed_mm_s", "set_g_min",
    "measured_g_min", "carrier_L_min", "shield_gas_L_min", "sent_line", "reentry",
    "reading_age_s", "line", "now_s", "refill_hopper", "designed",
)

#: Values of a mixture's kinds, as `journal_points` names its columns.
_MIXTURES = {
    "designed": ("planned", "the part file, at the line executed"),
    "planned": ("planned", "the job, at the line executed"),
    "commanded": ("commanded", "set-points sent to the feeders"),
    "nozzle": ("inferred", "set-points, feeder reports, dead time and lag of the hoses"),
}

#: What there is none of where a status does not say.
_EMPTY: dict[str, Any] = {"held_by": "", "levels": (), "warnings": (), "alarms": (), "next": (),
                          "interlocks": (), "origins": {}}

Snapshot = dict[str, Any]


def live_snapshot(
    status: Mapping[str, Any], mixture: Mapping[str, Any] | None, answer_age_s: float
) -> Snapshot:
    """Of a run that a process drives.

    status : its last answer, answer_age_s old; what an older version leaves out is not known
    mixture : as `latest_mixture` gives it
    """
    ages_s = status.get("reading_age_s") or [None] * len(status.get("hoppers", ()))
    return {
        **dict.fromkeys(_UNKNOWN), **_EMPTY, **status, "live": True,
        "answer_age_s": round(answer_age_s, 3), "mixture": mixture,
        "reading_age_s": [None if age_s is None else round(age_s + answer_age_s, 3)
                          for age_s in ages_s],
        "origins": {name: _aged(origin, answer_age_s)
                    for name, origin in status.get("origins", {}).items()},
    }


def ended_snapshot(
    folder: RunFolder, summary: RunSummary, header: Mapping[str, Any], last: Mapping[str, Any],
    mixture: Mapping[str, Any] | None,
) -> Snapshot:
    """Of a run that no process drives, from its journal.

    last : its last record, empty where there is none; every key of a live one is there
    """
    cause = last.get("cause")
    alarms = [{**cause, "where": [], "at_s": None, "cleared_s": None}] if isinstance(
        cause, dict) else []
    return {
        "run": folder.run, "part": summary.part, "machine": header.get("machine", ""),
        "operator": summary.operator, "layers": header.get("layers"),
        "lines": header.get("lines"),
        "hoppers": [one.get("name") for one in header.get("hoppers", ())],
        "materials": [one.get("material") for one in header.get("hoppers", ())],
        **dict.fromkeys(_UNKNOWN),
        "state": summary.state, "line": summary.lines, "now_s": summary.machine_s,
        **_EMPTY, "alarms": alarms, "next": _next(folder, summary, last),
        "live": False, "answer_age_s": None, "mixture": mixture,
    }


def latest_mixture(
    points: Mapping[str, list[Any]], materials: tuple[str, ...], now_s: float | None,
) -> dict[str, Any] | None:
    """The mixtures of the last point, None without one.

    now_s : machine time of the run now, None where it is not known
    returns : materials; designed, planned, commanded, nozzle (volume fractions, None: no mixture);
        origins
    """
    if not points.get("at_s") or "planned0" not in points:
        return None
    age_s = None if now_s is None else round(max(0.0, now_s - points["at_s"][-1]), 3)
    found: dict[str, Any] = {"materials": list(materials), "origins": {}}
    for name, (kind, source) in _MIXTURES.items():
        fractions = [points[f"{name}{at}"][-1] for at in range(len(materials))]
        found[name] = None if None in fractions else fractions
        found["origins"][name] = {"kind": kind, "source": source, "age_s": age_s}
    return found


def _next(
    folder: RunFolder, summary: RunSummary, last: Mapping[str, Any]
) -> list[dict[str, str]]:
    acts = [{"command": folder.command("log"), "does": "prints what was done"}]
    if summary.state == "broken off" or (
        last.get("recoverable") and summary.state in FINAL_STATES
    ):
        acts.insert(0, {"command": folder.command("recover"), "does": "goes on with the part"})
    return acts


def _aged(origin: Mapping[str, Any], by_s: float) -> dict[str, Any]:
    age_s = origin.get("age_s")
    return {**origin, "age_s": None if age_s is None else round(age_s + by_s, 3)}
