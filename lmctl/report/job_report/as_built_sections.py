"""Sections that compare what was built with the design, for the report that is signed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from lmctl.as_built.comparison import AsBuiltComparison
from lmctl.as_built.figures import TOLERANCES, AsBuiltSummary
from lmctl.report.as_built_picture import draw_as_built_plane
from lmctl.report.as_built_text import BUILT_BY
from lmctl.report.job_report.document import (
    Block,
    PictureBlock,
    ReportSection,
    TableBlock,
    TableColumn,
    TextBlock,
    fields,
)
from lmctl.report.log_layout import NO_VALUE

_PICTURE_MM = (180.0, 180.0 * 5.4 / 13.0)


def as_built_sections(
    found: AsBuiltComparison, heights_mm: Mapping[int, float]
) -> tuple[ReportSection, ...]:
    """Figures, pictures of layers, heights. heights_mm : {layer number: height to draw it at}"""
    summary = found.summary
    sections = [ReportSection("As built", (
        TextBlock(f"{BUILT_BY[summary.built_by]}.".capitalize(),
                  is_warning=summary.built_by == "predicted"),
        fields(list(_volumes(summary))), _composition(summary),
        *(TextBlock(f"Note: {note}.") for note in summary.notes), *_pictures(found, heights_mm),
    ), on_new_page=True)]
    if any(layer.built_mm is not None for layer in summary.layers):
        sections.append(_heights(summary))
    if summary.balance:
        sections.append(_balance(summary))
    return tuple(sections)


def _volumes(found: AsBuiltSummary) -> Iterator[tuple[str, str | None]]:
    yield "volume built", (f"{found.built_mm3:,.0f} of {found.design_mm3:,.0f} mm³ designed "
                           f"({100 * found.built_over_design:.1f} %)")
    yield "missing, surplus", f"{found.missing_mm3:,.0f} and {found.surplus_mm3:,.0f} mm³"
    yield "void in the core", NO_VALUE if found.core_void is None else (
        f"{100 * found.core_void:.2f} % of the {found.core_mm3:,.0f} mm³ deeper than a bead")
    known = found.height_mm is not None and found.planned_height_mm is not None
    yield "height over the core", (f"{found.height_mm:.2f} of {found.planned_height_mm:.2f} mm "
                                   "planned") if known else NO_VALUE


def _composition(found: AsBuiltSummary) -> Block:
    columns = (
        TableColumn("composition error", 1.6, is_text=True), TableColumn("mean"),
        TableColumn("RMS"), TableColumn("95 %"), TableColumn("99 %"),
        *(TableColumn(f"±{tolerance:g}", group="share within, %") for tolerance in TOLERANCES))
    rows = []
    for name, error in (("by volume", found.by_volume), ("along the path", found.by_path)):
        if error is None:
            rows.append((name, *[NO_VALUE] * (4 + len(TOLERANCES))))
        else:
            rows.append((name, *(f"{value:.4f}" for value in (error.mean, error.rms, error.p95,
                                                              error.p99)),
                         *(f"{100 * error.within[one]:.1f}" for one in TOLERANCES)))
    return TableBlock(columns, tuple(rows))


def _pictures(
    found: AsBuiltComparison, heights_mm: Mapping[int, float]
) -> Iterator[PictureBlock]:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "layer.png"
        for layer, z_mm in heights_mm.items():
            draw_as_built_plane(found, z_mm, f"layer {layer}", target)
            yield PictureBlock(target.read_bytes(), *_PICTURE_MM,
                               f"Layer {layer}: designed, built, difference.")


def _heights(found: AsBuiltSummary) -> ReportSection:
    columns = (TableColumn("layer"), TableColumn("planned"), TableColumn("built"),
               TableColumn("difference"))
    rows = tuple(
        (str(one.number), f"{one.planned_mm:.2f}",
         NO_VALUE if one.built_mm is None else f"{one.built_mm:.2f}",
         NO_VALUE if one.built_mm is None else f"{one.built_mm - one.planned_mm:+.2f}")
        for one in found.layers)
    return ReportSection("As built: height of layers above the plate, mm",
                         (TableBlock(columns, rows),))


def _balance(found: AsBuiltSummary) -> ReportSection:
    columns = (TableColumn("powder", 1.6, is_text=True), TableColumn("fed"),
               TableColumn("in the part"), TableColumn("overspray"), TableColumn("beam off"),
               TableColumn("unaccounted"), TableColumn("of fed, %"))
    rows = tuple(
        (one.material, f"{one.fed_g:.1f}", f"{one.deposited_g:.1f}", f"{one.overspray_g:.1f}",
         f"{one.beam_off_g:.1f}", f"{one.unaccounted_g:.1f}", f"{100 * one.closure:+.2f}")
        for one in found.balance)
    return ReportSection("As built: powder balance, g", (TableBlock(columns, rows),))
