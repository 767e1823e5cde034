"""The layers of a part as comma-separated values, units in the names of the columns."""

from __future__ import annotations

import csv
import io

from lmctl.report.layer_record import LayerRecord
from lmctl.report.log_layout import format_number
from lmctl.report.part_record import PartRecord

_FIGURES = (("path_mm", 3), ("beam_s", 3), ("energy_J", 1), ("duration_s", 3))
_KINDS = ("planned", "reported", "inferred", "unreported")


def part_record_as_csv(part: PartRecord) -> str:
    """One row a layer, without a trailing newline.

    reported holds what is named inferred as well; unreported is motion after a run's last report.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(layer_heads(part))
    for layer in part.layers:
        writer.writerow(layer_row(layer, part.hoppers))
    return text.getvalue().rstrip("\n")


def layer_heads(part: PartRecord) -> list[str]:
    """Names of the columns."""
    return [
        "layer", "z_mm", "paths", "lines", "complete",
        *(f"{kind}_{name}" for kind in _KINDS for name, _ in _FIGURES),
        *(f"{kind}_{hopper}_g" for hopper in part.hoppers for kind in _KINDS),
        *(f"weighed_{hopper}_g" for hopper in part.hoppers),
        "place_error_mm", "feed_percent_least", "feed_percent_most", "power_percent_least",
        "power_percent_most", "entered_again", "repeated_mm", "runs", "began", "ended",
    ]


def layer_row(layer: LayerRecord, hoppers: tuple[str, ...]) -> list[object]:
    """The cells of one layer, in the order of `layer_heads`."""
    of_kind = {"planned": layer.planned, "reported": layer.reported, "inferred": layer.inferred,
               "unreported": layer.unreported}
    feed, power = layer.feed_percent or ("", ""), layer.power_percent or ("", "")
    return [
        layer.number, format_number(layer.z_mm, 6), layer.paths,
        layer.lines[1] - layer.lines[0] + 1,
        "yes" if layer.complete else "no",
        *(format_number(getattr(of_kind[kind], name), decimals)
          for kind in _KINDS for name, decimals in _FIGURES),
        *(format_number(of_kind[kind].powder_g.get(hopper, 0.0), 4)
          for hopper in hoppers for kind in _KINDS),
        *(format_number(layer.weighed_g[hopper], 2) if hopper in layer.weighed_g else ""
          for hopper in hoppers),
        format_number(layer.place_error_mm, 3), *feed, *power, layer.entered_again,
        format_number(layer.repeated_mm, 3), " ".join(layer.runs), layer.began, layer.ended,
    ]
