"""Pictures of a report: the part as far as it was deposited, and three of its layers."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image

from lmctl.array_types import BoolArray, FloatArray
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, LineKind
from lmctl.report.composition_colours import (
    TWO_MATERIAL_COLOURMAP,
    composition_colours,
    material_colours,
)
from lmctl.report.job_report.document import PictureBlock
from lmctl.report.layer_record import LayerRecord
from lmctl.report.part_report import PartReport

_WIDTH_MM, _PART_MM, _LAYERS_MM, _KEY_MM = 180.0, 82.0, 66.0, 9.0
_DPI = 200
#: Layers and segments that the picture of the part draws at most.
_MOST_LAYERS, _MOST_SEGMENTS = 60, 40_000
#: Directions of x and y on paper: seen from the front, the right and above.
_ACROSS, _UP = np.array([0.87, -0.87]), np.array([0.35, 0.35])
_LEFT_OUT, _RIM, _MARK = "#d8d8d8", "#1a1a1a", "#c2185b"


@dataclass(frozen=True)
class _Beads:
    """Segments of bead of one layer. begins, ends : (n, 2) [mm]; colours (n, 3)

    deposited : (n,) as far as the record says
    """

    z_mm: float
    begins: FloatArray
    ends: FloatArray
    width_mm: FloatArray
    colours: FloatArray
    deposited: BoolArray


def report_pictures(report: PartReport) -> list[PictureBlock]:
    """The part and up to three of its layers; none where no job is there to draw them from."""
    layers = report.record.layers
    if report.job.manifest is None or not layers:
        return []
    with JobReader(report.job.path) as reader:
        materials = reader.manifest.materials
        return [
            _part_block(reader, layers, materials),
            _layers_block(reader, report, materials),
        ]


def _part_block(
    reader: JobReader, layers: Sequence[LayerRecord], materials: tuple[str, ...]
) -> PictureBlock:
    count = min(len(layers), _MOST_LAYERS)
    chosen = [layers[at] for at in np.unique(np.linspace(0, len(layers) - 1, count).astype(int))]
    beads = [_beads(reader.read_layer(one.number - 1), one, _MOST_SEGMENTS // len(chosen))
             for one in chosen]
    figure, (axes,) = _figure(_PART_MM, 1)
    places = [
        (_on_paper(one.begins, one.z_mm)[one.deposited], _on_paper(one.ends, one.z_mm)[
            one.deposited]) for one in beads]
    shown = np.concatenate([np.vstack(pair) for pair in places])
    if len(shown):
        points_per_mm = _fit(axes, shown, float(max(one.width_mm.max() for one in beads)))
        for one, (begins, ends) in zip(beads, places, strict=True):
            width = 0.8 * one.width_mm[one.deposited] * points_per_mm
            for add, colour in ((0.35, np.full((1, 3), 0.1)), (0.0, one.colours[one.deposited])):
                axes.add_collection(LineCollection(
                    list(np.stack([begins, ends], axis=1)), colors=colour, linewidths=width + add,
                    capstyle="round", rasterized=True))
    _key(figure, materials, [])
    of = "" if len(chosen) == len(layers) else f", {len(chosen)} of {len(layers)} layers drawn"
    return _block(figure, _PART_MM, f"The part as far as reports say that it was deposited, at the "
                                    f"planned places of its beads{of}; seen from the front right, "
                                    "colour by planned mixture.")


def _layers_block(
    reader: JobReader, report: PartReport, materials: tuple[str, ...]
) -> PictureBlock:
    layers = report.record.layers
    between = _layer_between(report)
    chosen = [layers[at] for at in sorted({0, between, len(layers) - 1})]
    figure, all_axes = _figure(_LAYERS_MM, len(chosen))
    marks: list[Line2D] = []
    for axes, one in zip(all_axes, chosen, strict=True):
        layer = reader.read_layer(one.number - 1)
        beads = _beads(layer, one, _MOST_SEGMENTS)
        if len(beads.begins):
            points_per_mm = _fit(axes, np.vstack([beads.begins, beads.ends]),
                                 float(beads.width_mm.max()))
            width = beads.width_mm * points_per_mm
            colours = np.where(beads.deposited[:, None], beads.colours, _grey())
            segments = list(np.stack([beads.begins, beads.ends], axis=1))
            axes.add_collection(LineCollection(segments, colors=_RIM, linewidths=width,
                                               capstyle="round"))
            axes.add_collection(LineCollection(segments, colors=colours, linewidths=0.82 * width,
                                               capstyle="round"))
        marks += _mark_entries(axes, report, layer)
        axes.set_title(f"layer {one.number}, z = {one.z_mm:.2f} mm", fontsize=7)
    _key(figure, materials, marks)
    return _block(figure, _LAYERS_MM, "The first and the last layer of the record, and one "
                                      "between them, at their planned places and bead widths; grey "
                                      "where no report says that a bead was deposited.")


def _layer_between(report: PartReport) -> int:
    """The first layer in which deposition was interrupted, else the middle one; its place."""
    layers = report.record.layers
    for one in report.record.interruptions:
        for at, layer in enumerate(layers):
            if one.line is not None and layer.lines[0] <= one.line <= layer.lines[1]:
                return at
    return len(layers) // 2


def _mark_entries(axes: Axes, report: PartReport, layer: JobLayer) -> list[Line2D]:
    first, last = layer.first_line, layer.first_line + len(layer.lines) - 1
    found: list[Line2D] = []
    for one in report.record.interruptions:
        if one.line is None or not first <= one.line <= last:
            continue
        row = layer.lines[one.line - first]
        found = axes.plot([row["x_mm"]], [row["y_mm"]], "v", ms=5, mfc=_MARK, mec="white", mew=0.6,
                          ls="", label="deposition interrupted", zorder=9)
    return found


def _beads(layer: JobLayer, record: LayerRecord, most: int) -> _Beads:
    """Bead segments of a layer, neighbours of one path joined where there are more than `most`."""
    lines = layer.lines
    bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
    bead = bead[bead > 0]
    at = np.column_stack([lines["x_mm"], lines["y_mm"]]).astype(np.float64)
    every = max(1, -(-len(bead) // most))
    path = lines["path"][bead]
    is_last = np.append(path[1:] != path[:-1], True)
    kept = np.flatnonzero((np.arange(len(bead)) % every == every - 1) | is_last)
    first = np.append(0, kept[:-1] + 1) if len(kept) else kept
    rows, starts = bead[kept], bead[first] - 1
    return _Beads(
        layer.z_mm, at[starts], at[rows], lines["bead_width_mm"][rows].astype(np.float64),
        composition_colours(lines["fractions"][rows]),
        record.complete | (layer.first_line + rows < record.reached_line))


def _on_paper(places: FloatArray, z_mm: float) -> FloatArray:
    return np.column_stack([places @ _ACROSS, places @ _UP + z_mm])


def _figure(height_mm: float, columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(_WIDTH_MM / 25.4, height_mm / 25.4), dpi=_DPI)
    below = _KEY_MM / height_mm
    found = []
    for column in range(columns):
        axes = figure.add_axes((column / columns + 0.005, below + 0.02, 1 / columns - 0.01,
                                0.97 - below - (0.08 if columns > 1 else 0.0)))
        axes.axis("off")
        found.append(axes)
    return figure, found


def _fit(axes: Axes, points: FloatArray, margin_mm: float) -> float:
    """Fit the axes to points at equal scale. Returns points of line width per millimetre."""
    box = axes.get_position()
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    size_in = np.array([box.width, box.height]) * figure.get_size_inches()
    low, high = points.min(axis=0) - margin_mm, points.max(axis=0) + margin_mm
    mm_per_inch = float(((high - low) / size_in).max())
    middle, half = (low + high) / 2, size_in * mm_per_inch / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    bar_mm = 10.0 ** np.floor(np.log10(size_in[0] * mm_per_inch / 3))
    left, low_y = middle[0] - half[0], middle[1] - half[1]
    axes.plot([left, left + bar_mm], [low_y, low_y], color=_RIM, lw=2, solid_capstyle="butt",
              clip_on=False)
    axes.text(left + bar_mm + 1.5 * mm_per_inch / 25.4, low_y, f"{bar_mm:g} mm", fontsize=6,
              va="center")
    return 72.0 / mm_per_inch


def _key(figure: Figure, materials: tuple[str, ...], marks: list[Line2D]) -> None:
    """Colours of the mixtures, at the foot."""
    height = figure.get_size_inches()[1] * 25.4
    if len(materials) == 2:
        axes = figure.add_axes((0.28, 4.6 / height, 0.3, 2.2 / height))
        figure.colorbar(ScalarMappable(Normalize(0.0, 100.0), TWO_MATERIAL_COLOURMAP), cax=axes,
                        orientation="horizontal")
        axes.tick_params(labelsize=6, length=2, pad=1)
        figure.text(0.27, 5.7 / height, f"% by volume of {materials[1]}", fontsize=7, ha="right",
                    va="center")
        if marks:
            figure.legend(handles=marks[:1], loc="lower right", fontsize=7, frameon=False,
                          bbox_to_anchor=(0.99, 0.0))
        return
    handles: list[Patch | Line2D] = [
        Patch(color=tuple(colour), label=name)
        for name, colour in zip(materials, material_colours(len(materials)), strict=True)]
    figure.legend(handles=[*handles, *marks[:1]], loc="lower center", ncols=6, fontsize=7,
                  frameon=False, bbox_to_anchor=(0.5, 0.0))


def _grey() -> FloatArray:
    from matplotlib.colors import to_rgb

    return np.array([to_rgb(_LEFT_OUT)])


def _block(figure: Figure, height_mm: float, caption: str) -> PictureBlock:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    file = io.BytesIO()
    Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3]).save(file, "png")
    return PictureBlock(file.getvalue(), _WIDTH_MM, height_mm, caption)
