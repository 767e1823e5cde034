"""A layer of a job as a picture: its tracks to scale, coloured by composition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from lmctl.job.schema import JobLayer, LineKind

FloatArray = NDArray[np.float64]

#: Anchor colours of the materials of a mixture of three or more; mixtures mix them linearly.
ANCHORS = ("#3b6ea5", "#d1642e", "#4a9a5b", "#8e5aa8", "#b59a2b", "#5f6b73")
#: Two materials read best on one perceptually even scale.
TWO_MATERIAL_MAP = "viridis"
_PICTURE_IN = (8.0, 7.2)
_AXES = (0.10, 0.09, 0.74, 0.82)


def draw_layer(
    layer: JobLayer,
    materials: tuple[str, ...],
    *,
    start_mm: tuple[float, float],
    track_pitch_mm: float,
    title: str,
    target: Path,
) -> None:
    """Draw one layer and save it; the ending of `target` (.png, .svg, .pdf) chooses the format.

    start_mm : (x, y) before the layer's first line
    track_pitch_mm : spacing of neighbouring tracks; each is drawn a little narrower, to scale, so
        that one shows beside the other (beads themselves overlap)
    Raises OSError where the file cannot be written.
    """
    ends = np.stack([layer.lines["x_mm"], layer.lines["y_mm"]], axis=1)
    starts = np.vstack([np.asarray(start_mm, dtype=float)[None, :], ends[:-1]])
    segments = np.stack([starts, ends], axis=1)
    kind = layer.lines["kind"]
    bead = kind == LineKind.BEAD

    figure = Figure(figsize=_PICTURE_IN, dpi=150)
    axes = figure.add_axes(_AXES)
    mm_per_point = _frame(axes, segments[bead] if bead.any() else segments, track_pitch_mm)
    moved = (starts != ends).any(axis=1)
    travel = moved & ((kind == LineKind.TRAVEL) | (kind == LineKind.LEAD))
    axes.add_collection(
        LineCollection(
            list(segments[travel]), colors="#9aa3ab", linewidths=0.5, linestyles=(0, (4, 3)),
            zorder=3,
        )
    )
    colours = composition_colours(layer.lines["fractions"][bead])
    axes.add_collection(
        LineCollection(
            list(segments[bead]), colors=colours, linewidths=0.86 * track_pitch_mm / mm_per_point,
            capstyle="round", zorder=2,
        )
    )
    _key(figure, axes, materials)
    axes.set_title(title, fontsize=10, loc="left")
    figure.savefig(target)


def composition_colours(fractions: NDArray[np.floating]) -> FloatArray:
    """Colours of volume fractions, (n, n_materials) -> (n, 3) float64 in [0, 1]."""
    values = np.asarray(fractions, dtype=np.float64)
    if values.shape[1] == 2:
        shades: FloatArray = colormaps[TWO_MATERIAL_MAP](values[:, 1])
        return np.asarray(shades[:, :3], dtype=np.float64)
    anchors = np.array([to_rgb(ANCHORS[i % len(ANCHORS)]) for i in range(values.shape[1])])
    mixed: FloatArray = np.clip(values @ anchors, 0.0, 1.0)
    return mixed


def _frame(axes: Axes, segments: FloatArray, margin_mm: float) -> float:
    """Fit the axes to the beads at equal scale. Returns millimetres per point of line width."""
    low = segments.reshape(-1, 2).min(axis=0) - 2 * margin_mm
    high = segments.reshape(-1, 2).max(axis=0) + 2 * margin_mm
    width_in = _PICTURE_IN[0] * _AXES[2]
    height_in = _PICTURE_IN[1] * _AXES[3]
    mm_per_inch = max((high[0] - low[0]) / width_in, (high[1] - low[1]) / height_in)
    middle = (low + high) / 2
    half = np.array([width_in, height_in]) * mm_per_inch / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    axes.tick_params(labelsize=8)
    return float(mm_per_inch / 72)


def _key(figure: Figure, axes: Axes, materials: tuple[str, ...]) -> None:
    if len(materials) == 2:
        bar_axes = figure.add_axes((_AXES[0] + _AXES[2] + 0.02, _AXES[1], 0.025, _AXES[3]))
        bar = figure.colorbar(
            ScalarMappable(Normalize(0, 1), colormaps[TWO_MATERIAL_MAP]), cax=bar_axes
        )
        bar.set_label(f"volume fraction of {materials[1]} (the rest is {materials[0]})", fontsize=8)
        bar.ax.tick_params(labelsize=8)
        return
    patches = [
        Patch(color=ANCHORS[i % len(ANCHORS)], label=name) for i, name in enumerate(materials)
    ]
    axes.legend(handles=patches, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8)
