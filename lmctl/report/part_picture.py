"""A part as a picture: its distance and its composition in three planes through its middle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from lmctl.array_types import FloatArray
from lmctl.part.part import Part
from lmctl.report.composition_colours import TWO_MATERIAL_COLOURMAP, composition_colours
from lmctl.report.panels import arrange_panels

DISTANCE_MAP = "RdBu"

#: Nodes along the longer side of each plane.
NODES = 300

#: How much of a plane's longer side is left free around the part.
MARGIN_FRACTION = 0.06

#: Iso-contours drawn on each side of the surface, about.
CONTOURS_PER_SIDE = 8

#: A substrate with a shape, and the line of its surface, in the composition.
_SUBSTRATE_COLOUR, _SUBSTRATE_LINE = (0.85, 0.85, 0.85), "#c0392b"

#: The longer side of a panel, the least height of a key, and its width [inches].
PANEL_IN, KEY_HEIGHT_IN, KEY_IN = 3.3, 2.4, 0.15

Places = tuple[float | None, float | None, float | None]


def draw_part(part: Part, at_mm: Places, target: Path) -> None:
    """Draw three planes of a part and save them; the ending of `target` chooses the format.

    at_mm : the x, y and z of the planes across each axis; None is the middle
    Raises OSError where the file cannot be written.
    """
    part_figure(part, at_mm).savefig(target)


def part_figure(part: Part, at_mm: Places) -> Figure:
    """Three planes of a part, distance above composition; at_mm : as `draw_part` takes it."""
    low, high = part.bounds_mm
    middle = 0.5 * (low + high)
    if part.substrate_surface is not None:  # half-way up in what is deposited
        surface_mm = float(part.substrate_surface.heights.height_mm(middle[None, :2])[0])
        middle[2] = 0.5 * (max(surface_mm, float(low[2])) + high[2])
    figure = Figure(dpi=130)
    axes = figure.subplots(2, 4)
    planes = [
        _plane(low, high, across, float(middle[across]) if place is None else place)
        for across, place in ((2, at_mm[2]), (1, at_mm[1]), (0, at_mm[0]))
    ]
    depths = [part.body.distance_at(plane.points) for plane in planes]
    reach = max(float(np.abs(depth).max()) for depth in depths)
    step = _even_step(float((high - low).max()) / (4 * CONTOURS_PER_SIDE))
    for column, (plane, depth) in enumerate(zip(planes, depths, strict=True)):
        _draw_distance(axes[0, column], plane, depth, step, reach)
        _draw_composition(axes[1, column], plane, depth, part)
        for axis in axes[:, column]:
            axis.set_aspect("equal")
            axis.set_xlabel(f"{plane.names[0]} [mm]")
            axis.set_ylabel(f"{plane.names[1]} [mm]")
        axes[0, column].set_title(plane.title, fontsize=10)
    shades = ScalarMappable(Normalize(-reach, reach), DISTANCE_MAP)
    figure.colorbar(shades, cax=axes[0, 3], label="distance, positive inside [mm]")
    _key(figure, axes[1, 3], tuple(material.name for material in part.materials))
    sizes = np.array([plane.size for plane in planes])
    sizes *= PANEL_IN / sizes.max(axis=1, keepdims=True)
    key = [[KEY_IN, max(KEY_HEIGHT_IN, float(sizes[:, 1].max()))]]
    widths, heights = np.tile(np.concatenate([sizes, key]).T[:, None, :], (1, 2, 1))
    below = "" if part.substrate_surface is None else "; grey: substrate"
    arrange_panels(figure, axes.tolist(), widths, heights,
                   f"{part.name}: distance (contours every {step:g} mm) and composition{below}")
    return figure


@dataclass(frozen=True, eq=False)
class _Plane:
    """points (n, 3) [mm] of an array of `shape`; extent and names of the picture's two axes"""

    points: FloatArray
    shape: tuple[int, int]
    extent: tuple[float, float, float, float]
    names: tuple[str, str]
    title: str

    @property
    def size(self) -> tuple[float, float]:
        """[mm]"""
        u0, u1, v0, v1 = self.extent
        return u1 - u0, v1 - v0


def _plane(low: FloatArray, high: FloatArray, across: int, at: float) -> _Plane:
    """A plane through a box, with a margin around it."""
    u, v = [axis for axis in range(3) if axis != across]
    margin = MARGIN_FRACTION * float(max(high[u] - low[u], high[v] - low[v]))
    u0, u1, v0, v1 = low[u] - margin, high[u] + margin, low[v] - margin, high[v] + margin
    pitch = max(u1 - u0, v1 - v0) / NODES
    us, vs = np.arange(u0 + pitch / 2, u1, pitch), np.arange(v0 + pitch / 2, v1, pitch)
    points = np.empty((len(vs), len(us), 3))
    points[:, :, u], points[:, :, v], points[:, :, across] = us, vs[:, None], at
    extent = (float(u0), float(us[-1] + pitch / 2), float(v0), float(vs[-1] + pitch / 2))
    return _Plane(points.reshape(-1, 3), (len(vs), len(us)), extent, ("xyz"[u], "xyz"[v]),
                  f"{'xyz'[across]} = {at:.4g} mm")


def _draw_distance(
    axes: Axes, plane: _Plane, depth: FloatArray, step: float, reach: float
) -> None:
    values = depth.reshape(plane.shape)
    axes.imshow(values, origin="lower", extent=plane.extent, cmap=DISTANCE_MAP, vmin=-reach,
                vmax=reach)
    levels = step * np.arange(np.ceil(depth.min() / step), np.floor(depth.max() / step) + 1)
    if len(levels):
        axes.contour(values, levels=levels, extent=plane.extent, colors="#00000055",
                     linewidths=0.5)
    _outline(axes, plane, depth, 1.2)


def _draw_composition(axes: Axes, plane: _Plane, depth: FloatArray, part: Part) -> None:
    colours = np.ones((len(depth), 3))
    above = _above_substrate_mm(plane, part)
    rows = np.flatnonzero((depth > 0) & (above > 0))
    colours[above <= 0] = _SUBSTRATE_COLOUR
    if len(rows):
        colours[rows] = composition_colours(part.composition(plane.points[rows]))
    axes.imshow(colours.reshape(*plane.shape, 3), origin="lower", extent=plane.extent,
                interpolation="nearest")
    _outline(axes, plane, depth, 0.8)
    if above.min() < 0 < above.max():
        known = np.where(np.isfinite(above), above, np.nan).reshape(plane.shape)
        axes.contour(known, levels=[0.0], extent=plane.extent, colors=_SUBSTRATE_LINE,
                     linewidths=1.2)


def _above_substrate_mm(plane: _Plane, part: Part) -> FloatArray:
    """Height of the plane's points over a substrate with a shape, (n,); inf on a plate."""
    if part.substrate_surface is None:
        return np.full(len(plane.points), np.inf)
    heights, places = part.substrate_surface.heights, plane.points[:, :2]
    return np.where(heights.covers(places), plane.points[:, 2] - heights.height_mm(places), np.inf)


def _outline(axes: Axes, plane: _Plane, depth: FloatArray, width: float) -> None:
    if depth.min() < 0 < depth.max():
        axes.contour(depth.reshape(plane.shape), levels=[0.0], extent=plane.extent,
                     colors="black", linewidths=width)


def _key(figure: Figure, axes: Axes, materials: tuple[str, ...]) -> None:
    if len(materials) == 2:
        figure.colorbar(
            ScalarMappable(Normalize(0.0, 1.0), TWO_MATERIAL_COLOURMAP), cax=axes,
            label=f"volume fraction of {materials[1]}",
        )
        return
    axes.set_axis_off()
    shares = np.eye(len(materials))
    handles = [
        Patch(color=tuple(colour), label=name)
        for name, colour in zip(materials, composition_colours(shares), strict=True)
    ]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(0.0, 0.5), frameon=False,
                borderaxespad=0.0)


def _even_step(size_mm: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(size_mm, 1e-6)))
    return float(min((1, 2, 5, 10), key=lambda m: abs(np.log(m * power / size_mm))) * power)
