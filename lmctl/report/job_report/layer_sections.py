"""Sections of figures by layer: beam, speed and power, powder and gas, mixture."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lmctl.report.job_report.document import ReportSection, TableBlock, TableColumn, TextBlock
from lmctl.report.layer_record import DEVIATION_TOLERANCE, LayerRecord, deviating_figures
from lmctl.report.log_layout import NO_VALUE
from lmctl.report.part_report import PartReport
from lmctl.report.process_values import ProcessValues
from lmctl.report.value_range import ValueRange
from lmctl.run.journal.figures import ExecutionFigures

#: Materials side by side in one table of mixtures.
_MATERIALS_A_TABLE = 2
_NOTHING = ProcessValues()
_LAYER = TableColumn("layer", 0.7)


def layer_sections(report: PartReport) -> Iterator[ReportSection]:
    """Every table of layers, each with planned and reported values side by side."""
    if not report.record.layers:
        yield ReportSection("Layers", (TextBlock("No layer was begun.", is_warning=True),))
        return
    yield _figures(report)
    yield _beam(report)
    for hopper in report.record.hoppers:
        yield _powder(report, hopper)
    for at in range(0, len(report.materials), _MATERIALS_A_TABLE):
        yield _mixture(report, report.materials[at:at + _MATERIALS_A_TABLE])


def _figures(report: PartReport) -> ReportSection:
    kinds = ("planned", "reported")
    columns = (
        _LAYER, TableColumn("z\nmm", 0.9),
        *(TableColumn(kind, group=group) for group in ("path, m", "beam on, s", "machine time, s",
                                                       "beam energy, kJ") for kind in kinds),
        TableColumn("off path\nmm", 0.8), TableColumn("remarks", 2.4, is_text=True),
    )
    rows = [
        (str(layer.number), f"{layer.z_mm:.3f}",
         *_pairs(layer.planned, layer.executed), f"{layer.place_error_mm:.2f}",
         layer.remark)
        for layer in report.record.layers
    ]
    record = report.record
    rows.append(("all", "", *_pairs(record.planned, record.executed), "", ""))
    return ReportSection("Layers: path, time and energy", (
        TableBlock(columns, tuple(rows), has_sum=True),
        TextBlock(f"* differs from the plan by more than {100 * DEVIATION_TOLERANCE:.0f} %. Off "
                  "path: greatest distance reported of the nozzle from the path. Layer height: "
                  "nothing in this cell has measured it."),
    ), on_new_page=True)


def _pairs(planned: ExecutionFigures, executed: ExecutionFigures) -> Iterator[str]:
    marked = deviating_figures(planned, executed)
    for name, scale, decimals in (
        ("path_mm", 1000.0, 3), ("beam_s", 1.0, 1), ("duration_s", 1.0, 1),
        ("energy_J", 1000.0, 2),
    ):
        yield f"{getattr(planned, name) / scale:.{decimals}f}"
        star = "*" if name in marked else ""
        yield f"{getattr(executed, name) / scale:.{decimals}f}{star}"


def _beam(report: PartReport) -> ReportSection:
    columns = (_LAYER, *(
        TableColumn(word, group=group)
        for group in ("power planned, W", "power reported, W", "speed planned, mm/s",
                      "speed reported, mm/s")
        for word in ("least", "mean", "most")), TableColumn("feed\noverride %", 1.1),
        TableColumn("power\noverride %", 1.1))
    rows = [
        (str(layer.number),
         *_range(planned.power_W, 0), *_range(reported.power_W, 0),
         *_range(planned.speed_mm_s, 2), *_range(reported.speed_mm_s, 2),
         _percent(layer.feed_percent), _percent(layer.power_percent))
        for layer, planned, reported in _values(report)
    ]
    return ReportSection("Layers: power and speed with the beam on",
                         (TableBlock(columns, tuple(rows)),))


def _powder(report: PartReport, hopper: str) -> ReportSection:
    columns = (
        _LAYER,
        *(TableColumn(word, group=group)
          for group in ("flow planned, g/min", "flow reported, g/min", "carrier gas, L/min")
          for word in ("least", "mean", "most")),
        *(TableColumn(word, group="powder, g") for word in ("planned", "reported", "weighed")),
    )
    rows = [
        (str(layer.number), *_range(planned.flow_g_min.get(hopper), 2),
         *_range(reported.flow_g_min.get(hopper), 2),
         *_range(reported.carrier_L_min.get(hopper), 2), *_grams(layer, hopper))
        for layer, planned, reported in _values(report)
    ]
    shield = [one.shield_gas_L_min for one in report.reported.values() if one.shield_gas_L_min]
    gas = "Shield gas: nothing in this cell reports its flow." if not shield else (
        f"Shield gas: {min(one.least for one in shield):.1f} to "
        f"{max(one.greatest for one in shield):.1f} L/min, reported, over all layers.")
    return ReportSection(f"Layers: powder and gas of hopper {hopper}, with the beam on", (
        TableBlock(columns, tuple(rows)),
        TextBlock(f"Flow planned: at the nozzle. Flow reported: off the feeder's disc, a dead time "
                  f"before it is at the nozzle. {gas}"),
    ))


def _grams(layer: LayerRecord, hopper: str) -> tuple[str, str, str]:
    star = "*" if hopper in deviating_figures(layer.planned, layer.executed) else ""
    weighed = layer.weighed_g.get(hopper)
    return (f"{layer.planned.powder_g.get(hopper, 0.0):.2f}",
            f"{layer.executed.powder_g.get(hopper, 0.0):.2f}{star}",
            NO_VALUE if weighed is None else f"{weighed:.1f}")


def _mixture(report: PartReport, materials: Sequence[str]) -> ReportSection:
    columns = (_LAYER, *(
        TableColumn(word, group=f"{name}, % by volume")
        for name in materials
        for word in ("designed", "planned", "predicted", "inferred\nleast", "inferred\nmean",
                     "inferred\nmost")))
    at = {name: index for index, name in enumerate(report.materials)}
    rows = []
    for layer, planned, reported in _values(report):
        cells = [str(layer.number)]
        mixture = report.mixtures.get(layer.number - 1)
        for name in materials:
            mean = planned.fractions.get(name)
            cells += [
                NO_VALUE if mixture is None else f"{100 * mixture.designed[at[name]]:.1f}",
                f"{100 * mixture.planned[at[name]]:.1f}" if mixture is not None
                else NO_VALUE if mean is None else f"{100 * mean.mean:.1f}",
                NO_VALUE if mixture is None else f"{100 * mixture.predicted[at[name]]:.1f}",
                *_range(reported.fractions.get(name), 1, scale=100.0),
            ]
        rows.append(tuple(cells))
    return ReportSection(f"Layers: mixture, {' and '.join(materials)}", (
        TableBlock(columns, tuple(rows)),
        TextBlock("Designed: the part file's own mixture along the beads. "
                  f"{_planned_words(report)} These are means over the length of bead. Inferred: at "
                  "the nozzle with the beam on, from the flows that the feeders reported, the "
                  "hoppers' dead times and lags, and catch efficiency over density of each powder; "
                  "nothing has measured the mixture itself."),
    ))


def _planned_words(report: PartReport) -> str:
    """What planned and predicted mean in this job."""
    manifest = report.job.manifest
    if manifest is None or "dilution" not in manifest.totals:
        return "Planned: the program's. Predicted: at the nozzle, by the plan's powder model."
    return ("Planned: the powder of the program, which makes up for dilution. Predicted: of the "
            "bead, by the plan's powder model, with what it melts of the layer below.")


def _values(report: PartReport) -> Iterator[tuple[LayerRecord, ProcessValues, ProcessValues]]:
    for layer in report.record.layers:
        index = layer.number - 1
        yield (layer, report.planned.get(index, _NOTHING), report.reported.get(index, _NOTHING))


def _range(values: ValueRange | None, decimals: int, scale: float = 1.0) -> tuple[str, str, str]:
    if values is None:
        return NO_VALUE, NO_VALUE, NO_VALUE
    return (f"{scale * values.least:.{decimals}f}", f"{scale * values.mean:.{decimals}f}",
            f"{scale * values.greatest:.{decimals}f}")


def _percent(span: tuple[int, int] | None) -> str:
    if span is None:
        return NO_VALUE
    return str(span[0]) if span[0] == span[1] else f"{span[0]}-{span[1]}"
