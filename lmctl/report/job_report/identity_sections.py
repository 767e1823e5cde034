"""Sections that say what a part is: numbers, machine, digests, powders, runs, calibration."""

from __future__ import annotations

from typing import Any

from lmctl.config.traveller import PowderLot
from lmctl.report.job_report.document import (
    Block,
    FieldList,
    ReportSection,
    TableBlock,
    TableColumn,
    TextBlock,
    fields,
)
from lmctl.report.log_layout import NO_VALUE, date_of, format_duration, format_number, time_of
from lmctl.report.part_report import PartReport
from lmctl.report.run_record import RunRecord

#: What each state of a part means to the person who signs for it.
_STATES = {
    "done": "done: every line of the job was executed",
    "stopped": "NOT COMPLETE: stopped by the operator",
    "faulted": "NOT COMPLETE: ended by a fault",
    "broken off": "NOT COMPLETE: the process that ran it died, and its journal has no end",
    "running": "NOT COMPLETE: it still runs",
}


def identity_section(report: PartReport) -> ReportSection:
    """The part, its numbers, and how it ended."""
    stated = report.traveller
    rows = fields([
        ("part", str(report.header.get("part", ""))),
        *((("copies", ", ".join(map(str, copies))),) if (
            copies := report.header.get("copies")) else ()),
        ("result", _STATES.get(report.record.state, report.record.state)),
        ("part number", stated.part_number), ("serial number", stated.serial),
        ("order", stated.order), ("customer", stated.customer),
        ("drawing", stated.drawing), ("drawing revision", stated.drawing_revision),
        ("procedure", stated.procedure),
    ])
    return ReportSection("Identity", (rows, *_warnings(report)))


def _warnings(report: PartReport) -> list[Block]:
    texts = []
    for run in report.record.runs:
        if run.verification.broken_line is not None:
            texts.append(f"The journal of {run.run} was damaged or altered at line "
                         f"{run.verification.broken_line}: {run.verification.reason}.")
        elif not run.verification.sealed:
            texts.append(f"The journal of {run.run} has no end: {run.verification.reason}. What it "
                         "holds up to there is whole.")
        if run.machine.get("beam_off"):
            texts.append(f"The beam stayed off throughout {run.run}: nothing was deposited in it.")
    if report.job.problem:
        texts.append(f"The job file beside the journal is not used: {report.job.problem}. Planned "
                     "process values, beam power and mixtures are therefore missing.")
    left = int(report.header.get("layers", 0)) - sum(
        layer.complete for layer in report.record.layers)
    if left > 0 and report.record.state == "done":
        texts.append(f"{left} layers are not complete in the record.")
    texts += [str(text) for text in report.header.get("warnings", [])]
    return [TextBlock(text, is_warning=True) for text in texts]


def machine_section(report: PartReport) -> ReportSection:
    """Machine, material around the powder, people, software."""
    header, stated, last = report.header, report.traveller, report.record.runs[-1]
    operators = dict.fromkeys(
        str(run.header.get("operator", "")) for run in report.record.runs)
    return ReportSection("Machine, material and people", (fields([
        ("machine", _machine(header, last)), ("machine serial", stated.machine_serial),
        ("controller", " ".join(str(last.machine[key]) for key in ("dialect", "version")
                                if last.machine.get(key))),
        ("nozzle", stated.nozzle),
        ("substrate", stated.substrate), ("substrate lot", stated.substrate_lot),
        ("gas", stated.gas), ("gas lot", stated.gas_lot),
        ("operator", ", ".join(name for name in operators if name)),
        ("software", f"{header.get('software', '')}; job planned with "
                     f"{header.get('planned_with', '')}"),
        ("powder mode", str(header.get("powder_mode", ""))),
    ]),))


def _machine(header: dict[str, Any], run: RunRecord) -> str:
    kind = "" if not run.machine else (
        ", a SIMULATED bench" if run.machine.get("is_bench") else ", a real machine")
    return f"{header.get('machine', '')}{kind}"


def powder_section(report: PartReport) -> ReportSection:
    """The powders by hopper, with what accompanies them on paper."""
    columns = (
        TableColumn("hopper", 0.8, is_text=True), TableColumn("powder", 1.4, is_text=True),
        TableColumn("lot", 1.6, is_text=True), TableColumn("certificate", 1.6, is_text=True),
        TableColumn("supplier", 1.6, is_text=True), TableColumn("reuse\ncount", 0.8),
        TableColumn("sieve", 1.0, is_text=True),
    )
    rows = []
    for hopper in report.header.get("hoppers", []):
        material = str(hopper["material"])
        lot = report.traveller.powder.get(material, PowderLot())
        rows.append((
            str(hopper["name"]), material, lot.lot, lot.certificate, lot.supplier,
            None if lot.reuse_count is None else str(lot.reuse_count), lot.sieve))
    return ReportSection("Powders", (TableBlock(columns, tuple(rows)),))


def digest_section(report: PartReport) -> ReportSection:
    """Every digest whole, so that files can be told apart by it."""
    header = report.header
    rows: list[tuple[str, str | None]] = [
        ("job", str(header.get("job", ""))),
        ("part file", str(header.get("part_sha256", ""))),
        ("machine profile", str(header.get("profile", ""))),
    ]
    used = header.get("calibration")
    if isinstance(used, dict) and used.get("digest"):
        rows.append(("calibration", str(used["digest"])))
    rows += [(str(name), str(digest)) for name, digest in header.get("sources", {}).items()]
    return ReportSection("SHA-256 digests", (FieldList(tuple(rows)),))


def runs_section(report: PartReport) -> ReportSection:
    """The runs that made the part, each continuing the one before."""
    columns = (
        TableColumn("run", 1.1, is_text=True), TableColumn("continues", 1.1, is_text=True),
        TableColumn("state", 1.1, is_text=True), TableColumn("begun (UTC)", 1.8, is_text=True),
        TableColumn("ended (UTC)", 1.8, is_text=True), TableColumn("machine time\nh:min:s", 1.2),
        TableColumn("operator", 1.4, is_text=True),
    )
    rows = []
    for run in report.record.runs:
        begun = str(run.header.get("local", {}).get("wall", ""))
        ended = str(run.seal.get("local", {}).get("wall", ""))
        rows.append((
            run.run, run.continues or NO_VALUE, run.state, stamp(begun), stamp(ended),
            format_duration(run.last_t_s), str(run.header.get("operator", "")) or NO_VALUE))
    return ReportSection("Runs", (TableBlock(columns, tuple(rows)),))


def calibration_section(report: PartReport) -> ReportSection:
    """The values that turned commands into beam and powder, and where each is from."""
    columns = (
        TableColumn("of", 1.2, is_text=True), TableColumn("quantity", 1.8, is_text=True),
        TableColumn("value", 0.9), TableColumn("unit", 0.7, is_text=True),
        TableColumn("95 % interval", 1.2, is_text=True),
        TableColumn("measured (UTC)", 1.3, is_text=True), TableColumn("by", 0.9, is_text=True),
        TableColumn("from", 1.5, is_text=True),
    )
    rows: list[tuple[str | None, ...]] = []
    used = report.header.get("calibration", {})
    measured: dict[str, str] = dict(used.get("measured", {})) if isinstance(used, dict) else {}

    def row(of: str, quantity: str, value: float, unit: str, what: str, otherwise: str) -> None:
        when = measured.get(what)
        rows.append((of, quantity, format_number(value, 4), unit, None,
                     stamp(when) if when else None, None, "calibration" if when else otherwise))

    for hopper in report.header.get("hoppers", []):
        of = f"hopper {hopper['name']}"
        for quantity, key, unit in (("dead time", "dead_time_s", "s"), ("lag", "lag_s", "s"),
                                    ("slope", "slope", NO_VALUE),
                                    ("offset", "offset_g_min", "g/min")):
            if key in hopper:
                row(of, quantity, float(hopper[key]), unit, of, "machine profile")
    caught = {str(one["material"]): one.get("catch_efficiency")
              for one in report.header.get("hoppers", [])}
    for powder in report.job.powders:
        origin = {key: "library, a default" if any(key in text for text in powder.defaults)
                  else "part file" for key in ("density", "catch")}
        row(powder.name, "density", powder.density_g_mm3 * 1000.0, "g/cm³", "", origin["density"])
        row(powder.name, "catch efficiency", caught.get(powder.name) or powder.catch_efficiency,
            NO_VALUE, f"catch of {powder.name}", origin["catch"])
    if (job := report.job.manifest) is not None:
        rows.append(("laser", "greatest power", format_number(job.max_power_W, 1), "W", None, None,
                     None, f"machine profile, at S{job.s_max}"))
    return ReportSection("Calibration values used", (
        TableBlock(columns, tuple(rows)),
        TextBlock("Blank: not in the journal. Fill in by hand what was measured, or what the "
                  "calibration file of the digest above states."),
    ))


def stamp(wall: str) -> str:
    """A wall clock stamp as people read it, to the second."""
    return f"{date_of(wall)} {time_of(wall)}" if wall else NO_VALUE
