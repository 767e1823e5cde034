"""What happened in a run, one journal record at a time, in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lmctl.report.log_layout import format_number

Record = dict[str, Any]


@dataclass(frozen=True)
class LoggedEvent:
    """Something a person should know of.

    seq : of the journal record; t_s : machine time since the run began; wall : UTC, "" where the
        record has none
    is_deviation : it is not as planned, so that a reason and a disposition belong to it
    """

    seq: int
    t_s: float
    wall: str
    text: str
    is_deviation: bool = False


def event_of(record: Record) -> LoggedEvent | None:
    """The event a record is of; None for records that are figures or samples."""
    words = _WORDS.get(str(record["kind"]))
    said = None if words is None else words(record)
    if said is None:
        return None
    text, is_deviation = said
    wall = record.get("local", {}).get("wall", "")
    return LoggedEvent(int(record["seq"]), float(record["t"]), str(wall), text, is_deviation)


_Said = tuple[str, bool] | None


def _header(record: Record) -> _Said:
    before = record.get("continues")
    return (f"goes on with the part of {before}", False) if before else ("run begun", False)


def _state(record: Record) -> _Said:
    return f"{record['from']} → {record['to']} ({record['event']})", False


def _act(record: Record) -> _Said:
    failed = record.get("failed")
    return (f"{record['do']} failed: {failed}", True) if failed else None


def _override(record: Record) -> _Said:
    power_percent = record.get("power_percent", 100)
    power = f", power override {power_percent} %" if power_percent != 100 else ""
    text = f"feed override {record['feed_percent']} %{power} ({record['source']})"
    is_reported = record["source"] == "controller"
    return text, is_reported and (record["feed_percent"], power_percent) != (100, 100)


def _operator(record: Record) -> _Said:
    name = record["operator"]
    who = f"operator {name}" if name else "operator"
    uid = record.get("local", {}).get("uid")
    who += f" (user {uid})" if uid is not None else ""
    refused = f", refused: {record['refused']}" if record.get("refused") else ""
    deviates = not refused and record["act"] in ("hold", "stop")
    return f"{who}: {record['act']}{refused}", deviates


def _alarm(record: Record) -> _Said:
    where = "; ".join(record.get("local", {}).get("where", ()))
    return f"ALARM: {record['what']}" + (f" ({where})" if where else ""), True


def _alarm_cleared(record: Record) -> _Said:
    return f"alarm over ({record['how']}): {record['what']}", False


def _warning(record: Record) -> _Said:
    if record["active"]:
        return f"WARNING: {record['what']}; what to do: {record['hint']}", False
    return f"warning over: {record['what']}", False


def _place(record: Record) -> _Said:
    return (f"deposition ended in line {record['line']}, {100 * record['share']:.0f} % of it "
            f"({record['known']})"), record["known"] == "unknown"


def _entry(record: Record) -> _Said:
    return (f"enters the part again at line {record['beam_on_line']}, "
            f"{record['repeated_mm']:.1f} mm deposited twice"), False


def _unreported(record: Record) -> _Said:
    begin, end = record["begin"], record["end"]
    return (
        f"inferred: layer {record['layer'] + 1} was executed from line {begin['line']} "
        f"({100 * begin['share']:.0f} %) to line {end['line']} ({100 * end['share']:.0f} %) "
        f"without a report, {record['figures']['path_mm']:.1f} mm of it with the beam on"
    ), True


def _fault(record: Record) -> _Said:
    kind = "then" if record.get("follows") else "FAULT"
    where = record.get("local", {}).get("where", ())
    return f"{kind}: " + "; ".join([record["what"], *where]), not record.get("follows")


def _refill(record: Record) -> _Said:
    weighed_g = record["weighed_g"]
    weighed = "" if weighed_g is None else f", {format_number(weighed_g, 1)} g by weight"
    return (f"hopper {record['hopper']} refilled: {record['material']}, lot {record['lot']}, "
            f"{format_number(record['mass_g'], 1)} g as stated{weighed}"), False


def _height(record: Record) -> _Said:
    """A height check; a part that powder alone cannot bring back to its height deviates."""
    after = f"height after layer {record['layers']}"
    if record["height_mm"] is None:
        return f"{after}: not measured", False
    powder = f"powder at {format_number(100 * record['volume_factor'], 1)} %"
    limit = ", the most there is" if record["at_limit"] else ""
    return (f"{after}: {format_number(record['height_mm'], 2)} mm of "
            f"{format_number(record['planned_mm'], 2)} mm planned ({record['source']}), "
            f"{powder}{limit}"), record["at_limit"]


def _hose_response(record: Record) -> _Said:
    if record["source"] != "measured":
        return f"this purge measured no hoses: {record['reason']}", False
    what = {"agrees": "as is led by", "replaces": "powder is led by it from now on",
            "refused": "not sure enough to lead powder by"}[record["revision"]]
    return (f"hopper {record['hopper']} measured by a purge: dead time "
            f"{format_number(record['dead_time_s'], 2)} ± "
            f"{format_number(record['dead_time_half_s'], 2)} s, lag "
            f"{format_number(record['lag_s'], 2)} ± {format_number(record['lag_half_s'], 2)} s, "
            f"{what}"), record["revision"] != "agrees"


_WORDS: dict[str, Callable[[Record], _Said]] = {
    "header": _header, "state": _state, "act": _act, "override": _override,
    "operator": _operator, "alarm": _alarm, "alarm_cleared": _alarm_cleared,
    "warning": _warning, "place": _place, "entry": _entry, "unreported": _unreported,
    "fault": _fault, "refill": _refill, "height": _height,
    "hose_response": _hose_response,
}
