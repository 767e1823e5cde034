"""A run as its journal tells it: what it was, its layers, what happened, how it ended.

Fields are modelled on the records of ASTM F2971 and NASA-STD-6030 (process.md 6.3), without any
claim to conform to them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lmctl.run.journal.file import Verification, read, verify


@dataclass(frozen=True)
class LayerRow:
    """One layer as it was run.

    number : from 1; lines, paths : how many
    beam_mm, beam_s, energy_J : as planned for the lines that were executed
    planned_s, lasted_s : program time planned, machine time taken
    fed_g : {hopper: mass its set-points asked for}
    """

    number: int
    z_mm: float
    paths: int
    lines: int
    beam_mm: float
    beam_s: float
    energy_J: float
    planned_s: float
    lasted_s: float
    fed_g: dict[str, float]
    ended: str


@dataclass(frozen=True)
class Happening:
    """Something a person should know of: a state, an act, a fault, an override."""

    t_s: float
    text: str


@dataclass(frozen=True)
class JobLog:
    """header, machine : the journal's own records; end : its seal, {} where there is none."""

    journal: Path
    header: dict[str, Any]
    machine: dict[str, Any]
    layers: tuple[LayerRow, ...]
    happenings: tuple[Happening, ...]
    end: dict[str, Any]
    last_t_s: float
    verification: Verification


@dataclass
class _Gathered:
    header: dict[str, Any] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)
    layers: list[LayerRow] = field(default_factory=list)
    happenings: list[Happening] = field(default_factory=list)
    end: dict[str, Any] = field(default_factory=dict)


def read_job_log(journal: Path) -> JobLog:
    """Gather a journal's log in one pass; only layers and happenings are kept in memory.

    Raises JournalError where the file is missing or is no journal.
    """
    verification = verify(journal)
    gathered = _Gathered()
    t_s = 0.0
    for record in read(journal):
        t_s = float(record["t"])
        _gather(record, t_s, gathered)
    return JobLog(
        journal, gathered.header, gathered.machine, tuple(gathered.layers),
        tuple(gathered.happenings), gathered.end, t_s, verification,
    )


def _gather(record: dict[str, Any], t_s: float, gathered: _Gathered) -> None:
    match record["kind"]:
        case "header":
            gathered.header = record
            if before := record.get("continues"):
                gathered.happenings.append(Happening(t_s, f"goes on with the part of {before}"))
        case "machine":
            gathered.machine = record
        case "layer":
            gathered.layers.append(_layer_row(record))
        case "state":
            gathered.happenings.append(
                Happening(t_s, f"{record['from']} → {record['to']} ({record['event']})")
            )
        case "act" if record.get("failed"):
            gathered.happenings.append(Happening(t_s, f"{record['do']} failed: {record['failed']}"))
        case "override":
            power_percent = record.get("power_percent", 100)
            power = f", power override {power_percent} %" if power_percent != 100 else ""
            gathered.happenings.append(Happening(
                t_s, f"feed override {record['feed_percent']} %{power} ({record['source']})"
            ))
        case "operator":
            refused = f", refused: {record['refused']}" if record.get("refused") else ""
            gathered.happenings.append(Happening(t_s, f"operator: {record['act']}{refused}"))
        case "warning":
            text = (f"WARNING: {record['what']}; what to do: {record['hint']}" if record["stands"]
                    else f"no longer: {record['what']}")
            gathered.happenings.append(Happening(t_s, text))
        case "place":
            gathered.happenings.append(Happening(
                t_s, f"motion at rest in line {record['line']}, {100 * record['share']:.0f} % of it"
            ))
        case "entry":
            gathered.happenings.append(Happening(
                t_s, f"enters the part again at line {record['lit_line']}, "
                f"{record['repeated_mm']:.1f} mm laid twice"
            ))
        case "fault":
            text = "; ".join([record["what"], *record.get("local", {}).get("where", ())])
            kind = "then" if record.get("follows") else "FAULT"
            gathered.happenings.append(Happening(t_s, f"{kind}: {text}"))
        case "seal":
            gathered.end = record


def _layer_row(record: dict[str, Any]) -> LayerRow:
    first, last = record["lines"]
    return LayerRow(
        number=record["layer"] + 1, z_mm=record["z_mm"], paths=record["paths"],
        lines=last - first + 1, beam_mm=record["beam_mm"], beam_s=record["beam_s"],
        energy_J=record["energy_J"], planned_s=record["planned_s"], lasted_s=record["lasted_s"],
        fed_g=record["fed_g"], ended=record.get("local", {}).get("wall", ""),
    )
