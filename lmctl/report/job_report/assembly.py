"""The whole report of a part as one document, section after section."""

from __future__ import annotations

from collections.abc import Sequence

from lmctl.job.margins_text import margins_text
from lmctl.report.job_report.document import (
    Block,
    PictureBlock,
    ReportDocument,
    ReportSection,
    TextBlock,
    fields,
)
from lmctl.report.job_report.event_sections import (
    alarm_section,
    balance_section,
    deviation_section,
    interruption_section,
    key_section,
    signature_section,
    verification_section,
)
from lmctl.report.job_report.identity_sections import (
    calibration_section,
    digest_section,
    identity_section,
    machine_section,
    powder_section,
    runs_section,
)
from lmctl.report.job_report.layer_sections import layer_sections
from lmctl.report.log_layout import NO_VALUE, format_duration
from lmctl.report.part_report import PartReport


def report_document(
    report: PartReport, pictures: Sequence[PictureBlock] = (),
    as_built: Sequence[ReportSection] = (),
) -> ReportDocument:
    """The report of a part.

    pictures : of the part and some of its layers, for the summary
    as_built : sections that compare what was built with the design, behind the layers
    """
    header, serial = report.header, report.traveller.serial
    part = str(header.get("part", ""))
    return ReportDocument(
        f"Job report: {part}",
        f"{'serial ' + serial + ', ' if serial else ''}{report.record.state}, "
        f"{', '.join(run.run for run in report.record.runs)} on {header.get('machine', '')}",
        f"{part}{' ' + serial if serial else ''}, job {str(header.get('job', ''))[:16]}…",
        (
            identity_section(report), machine_section(report), powder_section(report),
            digest_section(report), runs_section(report),
            _summary(report, pictures), *layer_sections(report), *as_built,
            deviation_section(report), alarm_section(report), interruption_section(report),
            balance_section(report), calibration_section(report), verification_section(report),
            key_section(), signature_section(),
        ))


def _summary(report: PartReport, pictures: Sequence[PictureBlock]) -> ReportSection:
    record, header = report.record, report.header
    planned, executed = record.planned, record.executed
    complete = sum(layer.complete for layer in record.layers)
    open_ = sum(not one.disposition for one in record.deviations)
    mixture = "" if report.job.manifest is None else _mixture_words(report.job.manifest.totals)
    rest_s = sum(one.duration_s or 0.0 for one in record.interruptions)
    blocks: list[Block] = [fields([
        ("layers complete", f"{complete} of {header.get('layers', NO_VALUE)}"),
        ("bead deposited", f"{executed.path_mm / 1000:.2f} m of {planned.path_mm / 1000:.2f} m "
                           "planned for the layers begun"),
        ("beam on", f"{format_duration(executed.beam_s)}, planned "
                    f"{format_duration(planned.beam_s)} (h:min:s)"),
        ("beam energy", f"{executed.energy_J / 1000:.1f} kJ, planned "
                        f"{planned.energy_J / 1000:.1f} kJ"),
        ("machine time", f"{format_duration(sum(run.last_t_s for run in record.runs))} over "
                         f"{len(record.runs)} {'run' if len(record.runs) == 1 else 'runs'}, of it "
                         f"{format_duration(executed.duration_s)} in layers"),
        ("interruptions", f"{len(record.interruptions)}, {format_duration(rest_s)} in all"),
        ("alarms", str(len(record.alarms))),
        ("deviations", f"{len(record.deviations)}, {open_} of them without a disposition"),
        ("mixture, as planned", mixture or NO_VALUE),
    ])]
    if report.job.manifest is not None:
        blocks += [TextBlock(f"Plan: {one['text']}.", is_warning=one["level"] == "warning")
                   for one in report.job.manifest.verdict]
    return ReportSection("Summary", (*blocks, *pictures), on_new_page=True)


def _mixture_words(totals: dict[str, object]) -> str:
    share, worst = totals.get("mixture_share"), totals.get("mixture_worst")
    if not isinstance(share, float) or not isinstance(worst, float):
        return ""
    predicted = margins_text(totals) or f"{share:.1%} of the path"
    return (f"predicted within ±0.02 of the part file's mixture along the path, ±0.03 by volume: "
            f"{predicted}; worst {worst:.3f} along the path")
