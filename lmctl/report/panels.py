"""Pictures in rows and columns, each of its own size, as far apart as their labels need.

The layout engines that come with the drawing library share a figure out: pictures of one scale on
both axes then have large gaps, or overlap each other's labels. Here the figure fits the pictures.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lmctl.array_types import FloatArray

#: Between what belongs to neighbours, and around all [inches].
GAP_IN, EDGE_IN = 0.2, 0.1

#: Where labels are measured: larger than any figure.
_TABLE_IN = 40.0


def arrange_panels(figure: Figure, axes: list[list[Axes]], widths_in: FloatArray,
                   heights_in: FloatArray,
                   title: str) -> None:
    """Place the axes of a figure, each in the middle of its cell, and size the figure to them.

    axes : by rows, as drawn and labelled; widths_in, heights_in : (rows, columns) [inches]
    """
    heading = figure.suptitle(title, va="top")
    labels = _room_for_labels(figure, axes, widths_in, heights_in)  # left, below, right, above
    heading_in = heading.get_window_extent()
    left, right = labels[:, :, 0].max(axis=0), labels[:, :, 2].max(axis=0)
    below, above = labels[:, :, 1].max(axis=1), labels[:, :, 3].max(axis=1)
    columns, rows = widths_in.max(axis=0), heights_in.max(axis=1)
    across = float((left + columns + right).sum()) + GAP_IN * (len(columns) - 1)
    width = max(across, heading_in.width / figure.dpi) + 2 * EDGE_IN
    top = heading_in.height / figure.dpi + GAP_IN + EDGE_IN
    height = top + float((below + rows + above).sum()) + GAP_IN * (len(rows) - 1) + EDGE_IN
    figure.set_size_inches(width, height)
    heading.set_y(1 - EDGE_IN / height)
    y = height - top
    for r, row in enumerate(axes):
        x, y = (width - across) / 2, y - above[r] - rows[r]
        for c, axis in enumerate(row):
            x += left[c]
            w, h = widths_in[r, c], heights_in[r, c]
            at = x + (columns[c] - w) / 2, y + (rows[r] - h) / 2
            axis.set_position((at[0] / width, at[1] / height, w / width, h / height))
            x += columns[c] + right[c] + GAP_IN
        y -= below[r] + GAP_IN


def _room_for_labels(
    figure: Figure, axes: list[list[Axes]], widths_in: FloatArray, heights_in: FloatArray
) -> FloatArray:
    """(rows, columns, 4): how far labels reach out to the left, below, to the right, above."""
    FigureCanvasAgg(figure)  # keeps what it draws on; without it each question gets a new one
    figure.set_size_inches(_TABLE_IN, _TABLE_IN)
    for r, row in enumerate(axes):
        for c, axis in enumerate(row):
            axis.set_position((0.5, 0.5, widths_in[r, c] / _TABLE_IN, heights_in[r, c] / _TABLE_IN))
    figure.draw_without_rendering()
    room = np.zeros((len(axes), len(axes[0]), 4))
    for r, row in enumerate(axes):
        for c, axis in enumerate(row):
            inner, outer = axis.get_window_extent(), axis.get_tightbbox()
            if outer is not None:
                room[r, c] = (inner.x0 - outer.x0, inner.y0 - outer.y0, outer.x1 - inner.x1,
                              outer.y1 - inner.y1)
    return np.maximum(room / figure.dpi, 0.0)
