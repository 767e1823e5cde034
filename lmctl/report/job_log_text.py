"""The record of a part as text that reads and prints well: 80 columns, no word broken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lmctl.config.measuring import calibration_text
from lmctl.report.layer_record import DEVIATION_TOLERANCE, deviating_figures
from lmctl.report.log_layout import (
    LINE_WIDTH,
    NO_VALUE,
    date_of,
    format_duration,
    format_number,
    table_lines,
    time_of,
    wrapped,
)
from lmctl.report.part_record import PartRecord
from lmctl.report.run_record import RunRecord
from lmctl.run.journal.figures import ExecutionFigures
from lmctl.run.journal.format import JournalVerification
from lmctl.run.journal.notes import Note
from lmctl.run.journal.run_folders import RunFolder

_KEY = 13

#: Hoppers side by side in one table.
_HOPPERS_A_TABLE = 2


def part_record_as_text(part: PartRecord) -> str:
    """The whole log, without a trailing newline."""
    sections = [_head(part), _runs(part)]
    if part.layers:
        sections += [_beam_table(part), _heat_table(part), *_powder_tables(part),
                     _time_table(part), _marks()]
    else:
        sections.append("no layer was begun")
    sections += [_deviations(part), *(_events(run) for run in part.runs), _journals(part)]
    return "\n\n".join(section for section in sections if section)


def integrity_text(found: JournalVerification) -> str:
    """What a journal's hashes say, in words."""
    if found.broken_line is not None:
        return f"BROKEN at line {found.broken_line}: {found.reason}"
    if found.sealed:
        return f"whole and sealed, {found.records:,} records"
    return f"not sealed ({found.reason}); {found.records:,} whole records"


# --- what it is ------------------------------------------------------------------------------


def _head(part: PartRecord) -> str:
    header = part.runs[0].header
    title = f"JOB LOG  {header.get('part', '')}"
    state = part.state.upper()
    rows = [
        *_cause(part.runs[-1]),
        ("job sha256", str(header.get("job", ""))),
        ("part sha256", str(header.get("part_sha256", ""))),
        ("profile", str(header.get("profile", ""))),
        ("machine", _machine(part.runs[-1])),
        ("software", f"{header.get('software', '')}, planned with "
                     f"{header.get('planned_with', '')}"),
        ("plan", f"{header.get('layers', 0)} layers, {header.get('lines', 0):,} program lines, "
                 f"{format_duration(float(header.get('planned_s', 0.0)))}"),
        ("copies", ", ".join(map(str, header.get("copies", [])))),
        *((f"hopper {hopper['name']}", _hopper(hopper)) for hopper in header.get("hoppers", [])),
        ("heat", _heat(header.get("predicted_heat") or {})),
        ("calibration", calibration_text(header.get("calibration") or {})),
        ("mixture", str(header.get("mixture", ""))),
        *(("alloy rule", _alloy_rule(rule)) for rule in header.get("alloy_rules", [])),
        *(("warning", str(text)) for text in header.get("warnings", [])),
    ]
    return "\n".join([
        title + state.rjust(LINE_WIDTH - len(title)), "─" * LINE_WIDTH,
        *(wrapped(key.ljust(_KEY), text) for key, text in rows if text),
    ])


def _cause(run: RunRecord) -> list[tuple[str, str]]:
    """What ended a run that was not done, or the alarms active when one was done; then the rest."""
    cause = run.seal.get("cause")
    if not cause:
        return []
    return [("alarm" if run.state == "done" else "cause", str(cause.get("what", ""))),
            *(("then", str(text)) for text in run.seal.get("followed", []))]


def _alloy_rule(rule: dict[str, object]) -> str:
    return (f"{rule.get('name')}: {rule.get('reason')}; planned mixtures differ from the part's "
            f"along {rule.get('changed_mm')} mm, by up to {rule.get('changed_by')}")


def _machine(run: RunRecord) -> str:
    name = str(run.header.get("machine", ""))
    if not run.machine:
        return name
    firmware = " ".join(str(run.machine[key]) for key in ("dialect", "version")
                        if run.machine.get(key))
    kind = "simulated bench" if run.machine.get("is_bench") else "real machine"
    beam = "; the beam stayed off" if run.machine.get("beam_off") else ""
    return f"{name} ({kind}, {firmware}{beam})"


def _heat(heat: dict[str, object]) -> str:
    """What the plan predicted of temperature; nothing of it is measured."""
    if not heat:
        return ""
    hottest_C = format_number(float(str(heat["interpass_C"])), 0)
    waits = format_duration(float(str(heat["wait_s"])))
    least = 100 * float(str(heat["least_power_factor"]))
    power = f"; beam power planned down to {least:.0f} % of the recipe's" if least < 99.5 else ""
    return (f"interpass predicted at most {hottest_C} °C in layer {heat['layer']}, limit "
            f"{heat['interpass_max_C']} °C; {waits} of waits planned in "
            f"{heat['layers_with_waits']} layers{power}")


def _hopper(hopper: dict[str, object]) -> str:
    return (
        f"{hopper['material']}, dead time {format_number(float(str(hopper['dead_time_s'])), 2)} s, "
            f"lag {format_number(float(str(hopper['lag_s'])), 2)} s")


def _runs(part: PartRecord) -> str:
    rows = []
    for run in part.runs:
        local = run.header.get("local", {})
        wall, ended = str(local.get("wall", "")), str(run.seal.get("local", {}).get("wall", ""))
        operator = str(run.header.get("operator", "")) or "not named"
        user = f" (user {local['uid']})" if "uid" in local else ""
        rows.append((
            run.run, run.state, f"{date_of(wall)} {time_of(wall)}", time_of(ended) or NO_VALUE,
            format_duration(run.last_t_s), f" {operator}{user}",
        ))
    heads = ("<run", "<state", "<begun (UTC)", "ended", "machine time", " operator")
    lines = ["runs", *table_lines(heads, rows, "  ")]
    for run in part.runs[:-1]:
        lines += [wrapped(f"  {run.run}  {key}: ", text) for key, text in _cause(run)]
    return "\n".join(lines)


# --- layers ----------------------------------------------------------------------------------


def _beam_table(part: PartRecord) -> str:
    heads = ["layer", "z mm"] + [
        f"{name}\n{kind}" for name in ("path m", "beam s", "kJ") for kind in ("planned", "reported")
    ]

    def row(label: str, z: str, planned: ExecutionFigures, executed: ExecutionFigures) -> list[str]:
        marks = deviating_figures(planned, executed)
        cells = [label, z]
        for name, scale, decimals in (
            ("path_mm", 1000.0, 3), ("beam_s", 1.0, 1), ("energy_J", 1000.0, 2),
        ):
            mark = "*" if name in marks else " "
            cells.append(f"{getattr(planned, name) / scale:.{decimals}f}")
            cells.append(f"{getattr(executed, name) / scale:.{decimals}f}{mark}")
        return cells

    rows = [row(str(layer.number), format_number(layer.z_mm, 3), layer.planned, layer.executed)
            for layer in part.layers]
    rows.append(row("all", "", part.planned, part.executed))
    return "\n".join(["beam", *table_lines(heads, rows)])


def _heat_table(part: PartRecord) -> str:
    """What the plan predicted of temperature, of the layers that were begun; "" where nothing."""
    heat = part.runs[0].header.get("predicted_heat") or {}
    begun = {layer.number for layer in part.layers}
    rows = [
        (str(one["layer"]), format_number(one["interpass_C"], 0),
         *(format_number(axis, 1) for axis in one["at_mm"]), format_number(one["wait_s"], 1),
         str(one["cuts"]), f"{100 * one['power_factor']:.0f}", one.get("order", "nearest"))
        for one in heat.get("by_layer", []) if one["layer"] in begun]
    if not rows:
        return ""
    heads = ("layer", "interpass °C\npredicted", "at x mm", "at y mm", "waits s\nplanned",
             "paths\ninterrupted", "power %\nof recipe", "order\nof tracks")
    return "\n".join(["heat, as the plan predicts it", *table_lines(heads, rows)])


def _powder_tables(part: PartRecord) -> Iterator[str]:
    """Powder off the discs, g; so many hoppers side by side as fit."""
    for at in range(0, len(part.hoppers), _HOPPERS_A_TABLE):
        names = part.hoppers[at:at + _HOPPERS_A_TABLE]
        heads = ["layer"] + [
            f"{name} g\n{kind}" for name in names for kind in ("planned", "reported", "weighed")
        ]
        rows = [
            _powder_row(str(layer.number), names, layer.planned, layer.executed, layer.weighed_g)
            for layer in part.layers
        ]
        rows.append(_powder_row("all", names, part.planned, part.executed, part.weighed_g))
        purged = part.purged_g
        rows.append(["purge", *(
            cell for name in names for cell in (NO_VALUE, f"{purged.get(name, 0.0):.2f} ",
                                                NO_VALUE))])
        yield "\n".join(["powder off the discs", *table_lines(heads, rows)])


def _powder_row(
    label: str, names: Sequence[str], planned: ExecutionFigures, executed: ExecutionFigures,
    weighed_g: dict[str, float],
) -> list[str]:
    marks = deviating_figures(planned, executed)
    cells = [label]
    for name in names:
        mark = "*" if name in marks else " "
        weighed = f"{weighed_g[name]:.1f}" if name in weighed_g else NO_VALUE
        cells += [f"{planned.powder_g.get(name, 0.0):.2f}",
                  f"{executed.powder_g.get(name, 0.0):.2f}{mark}", weighed]
    return cells


def _time_table(part: PartRecord) -> str:
    heads = ("layer", "begun\n(UTC)", "ended", "planned\ns", "took\ns", "feed\n%", "power\n%",
             "off path\nmm", " remarks")
    rows = [
        (str(layer.number), time_of(layer.began) or NO_VALUE, time_of(layer.ended) or NO_VALUE,
         f"{layer.planned.duration_s:.1f}", f"{layer.executed.duration_s:.1f}",
         _span(layer.feed_percent), _span(layer.power_percent), f"{layer.place_error_mm:.2f}",
         f" {layer.remark}")
        for layer in part.layers
    ]
    return "\n".join(["time, overrides and place, as reported", *table_lines(heads, rows)])


def _span(percent: tuple[int, int] | None) -> str:
    if percent is None:
        return NO_VALUE
    least, most = percent
    return str(least) if least == most else f"{least}-{most}"


def _marks() -> str:
    return wrapped("", (
        f"* differs from the plan by more than {100 * DEVIATION_TOLERANCE:.0f} %. Reported: from "
        "place, speed and power that the controller reports, and from what the feeders report of "
        "their discs; inferred where the remarks say so. Weighed: weight lost by the hopper. "
        "Powder counts from the first bead of a layer; what is fed before it is purge."
    ))


# --- what happened ---------------------------------------------------------------------------


def _deviations(part: PartRecord) -> str:
    lines = []
    for one in part.deviations:
        head = f"  {one.run} {'' if one.seq is None else f'#{one.seq}':<6} "
        lines.append(wrapped(head, one.text))
        lines += [_note(note, " " * len(head)) for note in one.notes]
        if not any(note.disposition for note in one.notes):
            lines.append(" " * len(head) + "no disposition yet")
    if lines:
        made = RunFolder(part.runs[-1].journal.parent)
        first = next((one for one in part.deviations
                      if not any(note.disposition for note in one.notes)), None)
        if first is not None and first.seq is not None:
            made = RunFolder(part.runs[0].journal.parent.parent / first.run)
            lines.append(wrapped("hint: ", f"`{made.command('note')} \"the reason\" --about "
                                           f"{first.seq} --disposition accepted`"))
        lines.insert(0, "deviations, with reason and disposition")
    if part.general_notes:
        lines += ["notes", *(_note(note, f"  {note.run} ") for note in part.general_notes)]
    return "\n".join(lines)


def _note(note: Note, head: str) -> str:
    disposition = f"{note.disposition}: " if note.disposition else ""
    about = f"on #{note.about}: " if note.about is not None and not head.isspace() else ""
    who = note.operator or f"user {note.uid}"
    return wrapped(head, f"{disposition}{about}{note.text} "
                         f"({who}, {date_of(note.wall)} {time_of(note.wall)} UTC)")


def _events(run: RunRecord) -> str:
    lines = [f"events of {run.run}: machine time, wall clock (UTC), number of the record"]
    date = ""
    for event in run.events:
        if date_of(event.wall) not in ("", date):
            date = date_of(event.wall)
            lines.append(f"  {date}")
        mark = f"#{event.seq}" if event.is_deviation else ""
        wall = time_of(event.wall) or NO_VALUE
        head = f"  {format_duration(event.t_s):>10}  {wall:<8}  {mark:<6} "
        lines.append(wrapped(head, event.text))
    return "\n".join(lines)


def _journals(part: PartRecord) -> str:
    lines = ["journals"]
    for run in part.runs:
        lines += [f"  {run.journal}", f"  {integrity_text(run.verification)}"]
        if (notes := run.notes_verification) is not None:
            sound = "its notes are whole, and made on this journal"
            lines.append(f"  {sound if notes.intact else 'NOTES: ' + integrity_text(notes)}")
    return "\n".join(lines)


