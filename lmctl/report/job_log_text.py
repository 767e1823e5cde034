"""A job log as text that reads and prints well: 100 columns, one row a layer."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from typing import Any

from lmctl.report.job_log import JobLog, LayerRow

_KEY = 12
_WIDTH = 100


def as_text(log: JobLog) -> str:
    """The whole log, without a trailing newline."""
    hoppers = _hopper_names(log)
    sections = [
        _head(log),
        "\n".join(_layer_table(log.layers, hoppers)) if log.layers
        else "no layer was finished",
        "\n".join(["happenings", *(f"  {_clock(h.t_s):>10}  {h.text}" for h in log.happenings)]),
        f"{'journal':<{_KEY}}{log.journal}\n{'':<{_KEY}}{integrity(log)}",
    ]
    return "\n\n".join(sections)


def as_csv(log: JobLog) -> str:
    """The layers as comma-separated values with a heading row; units in the names."""
    hoppers = _hopper_names(log)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([
        "layer", "z_mm", "paths", "lines", "beam_mm", "beam_s", "energy_J", "planned_s",
        "lasted_s", *(f"fed_{name}_g" for name in hoppers), "ended",
    ])
    for row in log.layers:
        writer.writerow([
            row.number, row.z_mm, row.paths, row.lines, row.beam_mm, row.beam_s, row.energy_J,
            row.planned_s, row.lasted_s, *(row.fed_g.get(name, "") for name in hoppers), row.ended,
        ])
    return text.getvalue().rstrip("\n")


def integrity(log: JobLog) -> str:
    """What the journal's hashes say, in words."""
    found = log.verification
    if found.broken_line is not None:
        return f"BROKEN at line {found.broken_line}: {found.reason}"
    if found.sealed:
        return f"whole and sealed, {found.records:,} records"
    return f"not sealed ({found.reason}); {found.records:,} whole records"


def _head(log: JobLog) -> str:
    header, local = log.header, log.header.get("local", {})
    run = str(local.get("run", log.journal.parent.name))
    state = str(log.end.get("state", "not finished"))
    rows: list[tuple[str, str]] = [
        ("part", str(header.get("part", ""))),
        ("job", f"sha256 {str(header.get('job', ''))[:16]}…"),
        ("machine", _machine(log)),
        ("operator", str(header.get("operator", "")) or "not named"),
        ("software", str(header.get("software", ""))),
        ("started", str(local.get("wall", ""))),
        ("ended", f"{log.end.get('local', {}).get('wall', 'no seal')}, "
                  f"after {_clock(log.last_t_s)} of machine time"),
    ]
    if cause := log.end.get("cause"):
        rows.append(("cause", str(cause.get("what", ""))))
        rows += [("then", str(text)) for text in log.end.get("followed", [])]
    rows += [("hopper", text) for text in _hoppers(header.get("hoppers", []))]
    rows += [("warning", str(text)) for text in header.get("warnings", [])]
    title = f"JOB LOG  {run}"
    lines = [f"{title}{state.upper():>{_WIDTH - len(title)}}", "─" * _WIDTH]
    return "\n".join(lines + [f"{key:<{_KEY}}{text}" for key, text in rows if text])


def _machine(log: JobLog) -> str:
    firmware = " ".join(
        str(log.machine[key]) for key in ("dialect", "version") if log.machine.get(key)
    )
    kind = "simulated bench" if log.machine.get("is_bench") else "real machine"
    name = str(log.header.get("machine", ""))
    return f"{name} ({kind}, {firmware})" if log.machine else name


def _hoppers(hoppers: Iterable[Any]) -> list[str]:
    return [
        f"{hopper['name']}: {hopper['material']}, θ {hopper['dead_time_s']:g} s, "
        f"τ {hopper['lag_s']:g} s"
        for hopper in hoppers
    ]


def _hopper_names(log: JobLog) -> list[str]:
    return [str(hopper["name"]) for hopper in log.header.get("hoppers", [])]


def _layer_table(rows: tuple[LayerRow, ...], hoppers: list[str]) -> list[str]:
    heading = (
        f"{'layer':>5} {'z mm':>8} {'paths':>6} {'lines':>8} {'path m':>8} {'beam s':>9} "
        f"{'planned s':>10} {'lasted s':>10} {'kJ':>8}"
        + "".join(f" {name[:6] + ' g':>8}" for name in hoppers)
    )
    table = [heading, "─" * len(heading)]
    table += [_row(f"{row.number:d}", f"{row.z_mm:.2f}", row, hoppers) for row in rows]
    total = LayerRow(
        number=0, z_mm=0.0, paths=sum(r.paths for r in rows), lines=sum(r.lines for r in rows),
        beam_mm=sum(r.beam_mm for r in rows), beam_s=sum(r.beam_s for r in rows),
        energy_J=sum(r.energy_J for r in rows), planned_s=sum(r.planned_s for r in rows),
        lasted_s=sum(r.lasted_s for r in rows),
        fed_g={name: sum(r.fed_g.get(name, 0.0) for r in rows) for name in hoppers}, ended="",
    )
    return [*table, "─" * len(heading), _row("all", "", total, hoppers)]


def _row(number: str, z: str, row: LayerRow, hoppers: list[str]) -> str:
    return (
        f"{number:>5} {z:>8} {row.paths:>6d} {row.lines:>8d} {row.beam_mm / 1000:>8.3f} "
        f"{row.beam_s:>9.1f} {row.planned_s:>10.1f} {row.lasted_s:>10.1f} "
        f"{row.energy_J / 1000:>8.1f}"
        + "".join(f" {row.fed_g.get(name, 0.0):>8.2f}" for name in hoppers)
    )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours:d}:{minutes:02d}:{rest:04.1f}"
