"""Sections on what happened: deviations, alarms, interruptions; powder balance and verification."""

from __future__ import annotations

from lmctl.report.job_log_text import integrity_text
from lmctl.report.job_report.document import (
    ReportSection,
    SignatureBlock,
    TableBlock,
    TableColumn,
    TextBlock,
)
from lmctl.report.job_report.identity_sections import stamp
from lmctl.report.log_layout import NO_VALUE, format_duration
from lmctl.report.part_report import PartReport

#: Rows of a table of events in print; a machine that chatters fills no more pages than that.
MAX_EVENT_ROWS = 500


def deviation_section(report: PartReport) -> ReportSection:
    """What was not as planned; reason and disposition are blank where none is noted."""
    columns = (
        TableColumn("run, record", 1.1, is_text=True), TableColumn("deviation", 3.6, is_text=True),
        TableColumn("cause", 2.2, is_text=True), TableColumn("lasted\nh:min:s", 1.0),
        TableColumn("reason", 2.0, is_text=True), TableColumn("disposition", 1.2, is_text=True),
    )
    found = report.record.deviations
    rows = tuple(
        (f"{one.run} {'' if one.seq is None else f'#{one.seq}'}", one.text,
         one.cause or NO_VALUE,
         NO_VALUE if one.duration_s is None else format_duration(one.duration_s),
         one.reason or None, one.disposition or None)
        for one in found[:MAX_EVENT_ROWS]
    )
    blocks = (TableBlock(columns, rows),) if rows else (TextBlock("None."),)
    notes = tuple(
        TextBlock(f"Note on {note.run}: {note.text} ({note.operator or 'not named'}, "
                  f"{stamp(note.wall)})")
        for note in report.record.general_notes)
    return ReportSection("Deviations", (*blocks, *_more(len(found)), *notes), on_new_page=True)


def alarm_section(report: PartReport) -> ReportSection:
    """Alarms as they were raised, which was the first out, and when each cleared."""
    columns = (
        TableColumn("run", 1.0, is_text=True), TableColumn("raised (UTC)", 1.6, is_text=True),
        TableColumn("machine\ntime", 1.0), TableColumn("alarm", 4.2, is_text=True),
        TableColumn("first\nout", 0.6, is_text=True), TableColumn("cleared (UTC)", 1.6,
                                                                  is_text=True),
        TableColumn("stood for\nh:min:s", 1.0), TableColumn("how", 1.3, is_text=True),
    )
    found = report.record.alarms
    rows = tuple(
        (one.run, stamp(one.raised), format_duration(one.raised_s), one.what,
         "yes" if one.is_first_out else "",
         stamp(one.cleared) if one.duration_s is not None else "stood when the run ended",
         NO_VALUE if one.duration_s is None else format_duration(one.duration_s),
         one.how or NO_VALUE)
        for one in found[:MAX_EVENT_ROWS]
    )
    blocks = (TableBlock(columns, rows),) if rows else (TextBlock("None."),)
    return ReportSection("Alarms", (*blocks, *_more(len(found))))


def interruption_section(report: PartReport) -> ReportSection:
    """Where deposition ended before the job did, and where the part was entered again."""
    columns = (
        TableColumn("run", 1.0, is_text=True), TableColumn("began (UTC)", 1.5, is_text=True),
        TableColumn("cause", 2.6, is_text=True), TableColumn("ended in", 1.9, is_text=True),
        TableColumn("place", 1.0, is_text=True), TableColumn("lasted\nh:min:s", 1.0),
        TableColumn("went on in", 1.1, is_text=True), TableColumn("entered again", 1.5,
                                                                  is_text=True),
        TableColumn("bead\ntwice, mm", 0.9),
    )
    found = report.record.interruptions
    rows = tuple(
        (one.run, stamp(one.began), one.cause,
         NO_VALUE if one.line is None else
         f"{_layer_of(report, one.line)}line {one.line}, {100 * one.share:.0f} %",
         one.known or NO_VALUE,
         NO_VALUE if one.duration_s is None else format_duration(one.duration_s),
         one.resumed_in or "never",
         NO_VALUE if one.entry_line is None else
         f"{_layer_of(report, one.entry_line)}line {one.entry_line}",
         f"{one.repeated_mm:.1f}")
        for one in found[:MAX_EVENT_ROWS]
    )
    blocks = (TableBlock(columns, rows), TextBlock(
        "Place: how it is known where the last bead ended. Reported: by the controller at "
        "standstill. Inferred: from what was sent. Stated: by the operator. Unknown: somewhere "
        "behind the last place reported.")) if rows else (TextBlock("None."),)
    return ReportSection("Pauses and re-entry", (*blocks, *_more(len(found))))


def _layer_of(report: PartReport, line: int) -> str:
    for layer in report.record.layers:
        if layer.lines[0] <= line <= layer.lines[1]:
            return f"layer {layer.number}, "
    return ""


def _more(count: int) -> tuple[TextBlock, ...]:
    if count <= MAX_EVENT_ROWS:
        return ()
    return (TextBlock(f"{count - MAX_EVENT_ROWS:,} more are in the journals, and not printed.",
                      is_warning=True),)


def balance_section(report: PartReport) -> ReportSection:
    """Where the powder went."""
    columns = (
        TableColumn("hopper", 0.8, is_text=True), TableColumn("powder", 1.3, is_text=True),
        TableColumn("planned\nin layers"), TableColumn("fed\nin layers"), TableColumn("purged"),
        TableColumn("used\nin all"), TableColumn("weighed\nin layers"), TableColumn("refilled"),
        TableColumn("in the part\n(predicted)"), TableColumn("not in\nthe part"),
    )

    def grams(value: float | None, decimals: int = 1) -> str:
        return NO_VALUE if value is None else f"{value:.{decimals}f}"

    rows = tuple(
        (one.hopper, one.material, grams(one.planned_g), grams(one.fed_g), grams(one.purged_g),
         grams(one.used_g), grams(one.weighed_g), grams(one.refilled_g), grams(one.caught_g),
         grams(one.lost_g))
        for one in report.powder_balances
    )
    return ReportSection("Powder balance, g", (TableBlock(columns, rows), TextBlock(
        "Fed: as the feeders report their discs. Weighed: weight lost by the hopper, where it "
        "weighed throughout. In the part: fed in layers times the share that the plan's catch "
        "efficiencies leave in the part; nothing has measured it.")))


def verification_section(report: PartReport) -> ReportSection:
    """What the hash chains prove, journal by journal."""
    columns = (TableColumn("file", 2.0, is_text=True), TableColumn("finding", 3.4, is_text=True),
               TableColumn("SHA-256 of the seal", 3.4, is_text=True))
    rows: list[tuple[str | None, ...]] = []
    for run in report.record.runs:
        name = f"{run.journal.parent.name}/{run.journal.name}"
        rows.append((name, integrity_text(run.verification),
                     str(run.seal.get("sha256", "")) or NO_VALUE))
        if (notes := run.notes_verification) is not None:
            rows.append((f"{run.journal.parent.name}, notes",
                         "whole, and made on this journal" if notes.intact
                         else integrity_text(notes), NO_VALUE))
    job = report.job
    rows.append((job.path.name, job.problem or "whole; its digest is the one in the journal",
                 NO_VALUE))
    return ReportSection("Verification of the records", (
        TableBlock(columns, tuple(rows)),
        TextBlock("Each record carries the hash of the one before it, and the seal that of the "
                  "whole. This finds damage and careless editing; it carries no secret, so it is "
                  "no proof against forgery."),
    ))


def signature_section() -> ReportSection:
    """Who has made, checked and released the part."""
    return ReportSection("Signatures", (SignatureBlock(("made by", "checked by", "released by")),))


def key_section() -> ReportSection:
    """Units, symbols and words of this report."""
    columns = (TableColumn("sign or word", 1.3, is_text=True), TableColumn("meaning", 5.0,
                                                                        is_text=True))
    rows = (
        ("mm, m", "millimetre, metre; places in program coordinates of the machine"),
        ("s; h:min:s", "second; hours, minutes, seconds of machine time, holds left out of layers"),
        ("W, J, kJ", "watt of beam power, joule and kilojoule of beam energy"),
        ("g, g/min", "gram of powder, gram a minute"),
        ("L/min", "litre of gas a minute, at norm conditions"),
        ("% by volume", "of the solid deposit"),
        ("UTC", "wall clock of the host, in universal time"),
        ("planned", "as the job file has it, at an override of 100 %"),
        ("reported", "as controller, feeders and safety device reported it, five times a second; "
                     "for layers it includes what is inferred, which the remarks tell"),
        ("inferred", "worked out from reports and settings, not reported"),
        ("predicted", "by the plan's own model"),
        ("weighed", "weight that the hopper's load cell lost"),
        ("#", "number of a record in the journal"),
        (NO_VALUE, "not known, or not applicable"),
        ("ruled line", "to be filled in by hand"),
    )
    return ReportSection("Key", (TableBlock(columns, rows), TextBlock(
        "The fields of this report are modelled on those of ASTM F2971 and NASA-STD-6030. That is "
        "no statement of conformity.")))
