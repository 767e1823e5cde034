"""A layer of a job as a picture: beads at their own width, in order, coloured by composition.

Beads are drawn one over the other as they are deposited, each with a dark rim, so that a covered
layer looks covered and a gap shows the paper. Starts, directions, travel and lead-ins have a
legend; a bar gives the scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobLayer, LineKind
from lmctl.report.composition_colours import (
    MAX_MIXED_MATERIALS,
    TWO_MATERIAL_COLOURMAP,
    composition_colours,
    material_colours,
)

_PICTURE_IN = (9.6, 7.6)
_AXES = (0.08, 0.08, 0.68, 0.83)
_KEY_LEFT = 0.80
_RIM, _TRAVEL, _LEAD, _MARK = "#1a1a1a", "#c2185b", "#777777", "#ffffff"
#: A bead's rim takes so much of its width on either side [points], but no more than this part.
_RIM_POINTS, _RIM_SHARE = 0.6, 0.05
#: Paths are numbered up to so many; more would cover the picture.
_MOST_NUMBERED = 60
#: One arrow for so many bead widths of path.
_ARROW_BEADS = 25.0


@dataclass(frozen=True)
class LayerView:
    """What the picture shows in addition to the layer itself.

    start_mm : (x, y) before the layer's first line, in program coordinates
    origin_mm : (x, y), subtracted from program coordinates; zero for those of the machine
    frame : "machine" or "part", whose coordinates the axes then show
    """

    start_mm: tuple[float, float]
    origin_mm: tuple[float, float]
    frame: str
    title: str


def draw_layer(
    layer: JobLayer, materials: tuple[str, ...], view: LayerView, target: Path
) -> None:
    """Draw one layer and save it; the ending of `target` (.png, .svg, .pdf) chooses the format.

    Raises OSError where the file cannot be written.
    """
    ends = np.stack([layer.lines["x_mm"], layer.lines["y_mm"]], axis=1) - view.origin_mm
    start = np.asarray(view.start_mm, dtype=float) - view.origin_mm
    begins = np.vstack([start[None, :], ends[:-1]])
    kind = layer.lines["kind"]
    bead = np.flatnonzero(kind == LineKind.BEAD)
    figure = Figure(figsize=_PICTURE_IN, dpi=150)
    axes = figure.add_axes(_AXES)
    width_mm = layer.lines["bead_width_mm"].astype(np.float64)
    widest = float(width_mm.max(initial=0.0)) or 1.0
    shown = np.vstack([begins[bead], ends[bead]]) if len(bead) else ends
    mm_per_point = _frame(axes, shown, widest, view.frame)
    if len(bead):
        _draw_beads(axes, begins[bead], ends[bead], width_mm[bead] / mm_per_point,
                    composition_colours(layer.lines["fractions"][bead]),
                    layer.lines["path"][bead])
        _draw_order(axes, begins[bead], ends[bead], layer.lines["path"][bead], widest)
    moved = (begins != ends).any(axis=1)
    for of, colour, style in ((LineKind.TRAVEL, _TRAVEL, (0, (4, 3))), (LineKind.LEAD, _LEAD, "-")):
        rows = np.flatnonzero(moved & (kind == of))
        axes.add_collection(LineCollection(
            list(np.stack([begins[rows], ends[rows]], axis=1)), colors=colour, linewidths=0.9,
            linestyles=[style], zorder=4))
    _scale_bar(axes)
    _key(figure, materials)
    axes.set_title(view.title, fontsize=10, loc="left")
    figure.savefig(target)


def _draw_beads(
    axes: Axes, begins: FloatArray, ends: FloatArray, width_points: FloatArray,
    colours: FloatArray, path: NDArray[np.integer],
) -> None:
    """Every path as a dark line and a coloured one over it, before the next path begins."""
    first = np.flatnonzero(np.append(True, np.diff(path) != 0))
    order, is_rim = [], []
    for a, b in zip(first, np.append(first[1:], len(path)), strict=True):
        rows = np.arange(a, b)
        order += [rows, rows]
        is_rim += [np.ones(b - a, dtype=bool), np.zeros(b - a, dtype=bool)]
    rows, rim = np.concatenate(order), np.concatenate(is_rim)
    shade = np.where(rim[:, None], np.array([[0.1, 0.1, 0.1]]), colours[rows])
    inner = width_points - 2 * np.minimum(_RIM_POINTS, _RIM_SHARE * width_points)
    width = np.where(rim, width_points[rows], inner[rows])
    axes.add_collection(LineCollection(
        list(np.stack([begins[rows], ends[rows]], axis=1)), colors=shade, linewidths=width,
        capstyle="round", zorder=2))


def _draw_order(
    axes: Axes, begins: FloatArray, ends: FloatArray, path: NDArray[np.integer], widest_mm: float
) -> None:
    """Where paths start, their numbers, and arrows in their direction."""
    first = np.flatnonzero(np.append(True, np.diff(path) != 0))
    axes.plot(*begins[first].T, "o", ms=4.5, mfc=_MARK, mec=_RIM, mew=0.8, zorder=6)
    if len(first) <= _MOST_NUMBERED:
        for number, (x, y) in enumerate(begins[first], start=1):
            axes.annotate(str(number), (x, y), (3.5, 3.5), textcoords="offset points", fontsize=6,
                          zorder=7, bbox={"boxstyle": "round,pad=0.1", "fc": _MARK, "ec": "none",
                                          "alpha": 0.75})
    length = np.linalg.norm(ends - begins, axis=1)
    along = np.cumsum(length)
    since = along - np.repeat(along[first] - length[first], np.diff(np.append(first, len(path))))
    step = _ARROW_BEADS * widest_mm
    marks = np.flatnonzero(np.floor((since + step * 0.75) / step)
                           > np.floor((since - length + step * 0.75) / step))
    direction = (ends - begins)[marks] / np.maximum(length[marks], 1e-9)[:, None]
    middle = (ends + begins)[marks] / 2
    axes.quiver(*middle.T, *direction.T, color=_MARK, edgecolor=_RIM, linewidth=0.4, angles="xy",
                scale_units="xy", scale=1 / (0.9 * widest_mm), units="xy",
                width=0.12 * widest_mm, headwidth=3.5, headlength=3.5, headaxislength=3.2,
                pivot="middle", zorder=5)


def _frame(axes: Axes, points: FloatArray, margin_mm: float, frame: str) -> float:
    """Fit the axes to the beads at equal scale. Returns millimetres per point of line width."""
    low, high = points.min(axis=0) - 1.5 * margin_mm, points.max(axis=0) + 1.5 * margin_mm
    low[1] -= 0.07 * (high[1] - low[1])  # room for the scale bar
    width_in, height_in = _PICTURE_IN[0] * _AXES[2], _PICTURE_IN[1] * _AXES[3]
    mm_per_inch = max((high[0] - low[0]) / width_in, (high[1] - low[1]) / height_in)
    middle = (low + high) / 2
    half = np.array([width_in, height_in]) * mm_per_inch / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_xlabel(f"{frame} x [mm]")
    axes.set_ylabel(f"{frame} y [mm]")
    axes.tick_params(labelsize=8)
    return float(mm_per_inch / 72)


def _scale_bar(axes: Axes) -> None:
    """A bar of a round length, about a fifth of the picture's width, in its lower left."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    wanted = (right - left) / 5
    power = 10 ** np.floor(np.log10(wanted))
    length = float(power * max(step for step in (1, 2, 5) if step * power <= wanted))
    x, y = left + 0.03 * (right - left), low + 0.03 * (high - low)
    axes.add_patch(Rectangle((x, y), length, 0.008 * (high - low), color=_RIM, zorder=8))
    axes.text(x + length / 2, y + 0.013 * (high - low), f"{length:g} mm", ha="center", va="bottom",
              fontsize=8, zorder=8)


def _key(figure: Figure, materials: tuple[str, ...]) -> None:
    """What colours and signs mean, to the right of the picture."""
    if len(materials) == 2:
        bar_axes = figure.add_axes((_KEY_LEFT, 0.40, 0.025, 0.51))
        bar = figure.colorbar(
            ScalarMappable(Normalize(0, 1), colormaps[TWO_MATERIAL_COLOURMAP]), cax=bar_axes)
        bar.set_label(f"volume fraction of {materials[1]} (the rest is {materials[0]})", fontsize=8)
        bar.ax.tick_params(labelsize=8)
    elif len(materials) == 3:
        _triangle(figure.add_axes((_KEY_LEFT, 0.66, 0.16, 0.20)), materials)
    else:
        pure = material_colours(len(materials))
        patches = [Patch(color=colour, label=name)
                   for name, colour in zip(materials, pure, strict=True)]
        title = None if len(materials) == 1 else (
            "mixtures mix their colours" if len(materials) <= MAX_MIXED_MATERIALS
            else "largest share, paler\nthe smaller it is")
        figure.legend(handles=patches, loc="upper left", bbox_to_anchor=(_KEY_LEFT - 0.02, 0.92),
                      fontsize=8, title=title, title_fontsize=8, frameon=False)
    signs = [
        Line2D([], [], marker="o", ls="", ms=4.5, mfc=_MARK, mec=_RIM, label="start of a path"),
        Line2D([], [], marker=r"$\rightarrow$", ls="", ms=9, color=_RIM, label="direction"),
        Line2D([], [], color=_TRAVEL, lw=0.9, ls=(0, (4, 3)), label="travel, beam off"),
        Line2D([], [], color=_LEAD, lw=0.9, label="lead-in, lead-out"),
    ]
    figure.legend(handles=signs, loc="lower left", bbox_to_anchor=(_KEY_LEFT - 0.02, 0.07),
                  fontsize=8, frameon=False, title="numbers: order of paths", title_fontsize=8,
                  alignment="left")


def _triangle(axes: Axes, materials: tuple[str, ...]) -> None:
    """All mixtures of three materials, each at its place between the corners, a line a tenth."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(0.75)]])
    n = 40
    shares = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    places = shares @ corners
    axes.scatter(places[:, 0], places[:, 1], c=composition_colours(shares), s=9, marker="h",
                 linewidths=0)
    for tenth in np.arange(2, 10, 2) / 10:
        for k in range(3):
            a, b = np.zeros((2, 3))
            a[k] = b[k] = tenth
            a[(k + 1) % 3], b[(k + 2) % 3] = 1 - tenth, 1 - tenth
            axes.plot(*np.stack([a @ corners, b @ corners]).T, color=_MARK, lw=0.4)
    for name, (x, y), side in zip(materials, corners, ("top", "top", "bottom"), strict=True):
        axes.text(x, y + (0.05 if side == "bottom" else -0.05), name, fontsize=8, ha="center",
                  va=side)
    axes.text(0.5, -0.24, "lines: 20, 40, 60, 80 %", fontsize=7, ha="center", va="top")
    axes.set_aspect("equal")
    axes.set_xlim(-0.1, 1.1)
    axes.set_ylim(-0.35, 1.05)
    axes.axis("off")
