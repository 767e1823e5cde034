"""A layer as designed, as built, and the difference, side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.as_built.comparison import AsBuiltComparison
from lmctl.report.composition_colours import (
    TWO_MATERIAL_COLOURMAP,
    composition_colours,
    material_colours,
)

_SIZE_IN = (13.0, 5.4)
_ERROR_COLOURMAP = "magma_r"
#: The scale of the difference ends here.
_WORST = 0.1
_MISSING, _SURPLUS = (0.80, 0.10, 0.10), (0.10, 0.35, 0.80)
#: A voxel is missing or surplus when it is off by more than this share of it.
_HALF = 0.5


def draw_as_built_plane(
    found: AsBuiltComparison, z_mm: float, title: str, target: Path
) -> None:
    """Draw the plane of voxels at height z of the part and save it; the ending chooses the format.

    Raises OSError where the file cannot be written.
    """
    plane = int(np.clip((z_mm - found.corner_mm[2]) / found.voxel_mm[2], 0,
                        found.filled.shape[2] - 1))
    inside = found.design.distance_mm[:, :, plane] >= 0
    filled = found.filled[:, :, plane] >= _HALF
    at, of_plane = _rows_in_plane(found, plane)
    figure = Figure(figsize=_SIZE_IN, dpi=130)
    axes = [figure.add_axes((0.05 + 0.32 * i, 0.16, 0.27, 0.70)) for i in range(3)]
    extent = _extent(found)
    for axis, name, fractions in (
        (axes[0], "designed", _designed(found, plane)),
        (axes[1], "built", _spread(found, plane, found.built_fractions[of_plane], at)),
    ):
        _show(axis, _colours(found, fractions), extent, name)
    error = np.full(inside.shape, np.nan)
    error.ravel()[at] = found.error[of_plane]
    shades = colormaps[_ERROR_COLOURMAP](Normalize(0, _WORST)(np.nan_to_num(error)))[..., :3]
    shades[np.isnan(error)] = 1.0
    shades[inside & ~filled] = _MISSING
    shades[filled & ~inside] = _SURPLUS
    _show(axes[2], shades, extent, "difference")
    _keys(figure, found)
    figure.suptitle(title, fontsize=10, x=0.05, y=0.95, ha="left")
    figure.savefig(target)


def _rows_in_plane(
    found: AsBuiltComparison, plane: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Flat places in the plane of the compared voxels in it, and their rows."""
    nz = found.filled.shape[2]
    rows = np.flatnonzero(found.rows % nz == plane)
    return found.rows[rows] // nz, rows


def _designed(found: AsBuiltComparison, plane: int) -> FloatArray:
    """(nx, ny, n_materials) designed fractions, NaN outside."""
    nz = found.filled.shape[2]
    rows = np.flatnonzero(found.design.rows % nz == plane)
    fractions = np.zeros((len(rows), len(found.materials)))
    fractions[:, : found.design.fractions.shape[1]] = found.design.fractions[rows]
    return _spread(found, plane, fractions, found.design.rows[rows] // nz)


def _spread(
    found: AsBuiltComparison, plane: int, fractions: FloatArray, at: NDArray[np.intp]
) -> FloatArray:
    shape = found.filled.shape[:2]
    whole = np.full((shape[0] * shape[1], fractions.shape[1]), np.nan)
    whole[at] = fractions
    return whole.reshape(*shape, -1)


def _colours(found: AsBuiltComparison, fractions: FloatArray) -> FloatArray:
    """Colours of the part's own materials; what else was built takes its share in white."""
    own = fractions[..., : found.design.fractions.shape[1]]
    shades = np.ones((*fractions.shape[:2], 3))
    known = ~np.isnan(own).any(axis=2)
    total = own[known].sum(axis=1, keepdims=True)
    mixed = composition_colours(own[known] / np.maximum(total, 1e-9))
    shades[known] = np.clip(mixed * total + (1 - total), 0, 1)
    return shades


def _extent(found: AsBuiltComparison) -> tuple[float, float, float, float]:
    low = found.corner_mm
    high = low + found.voxel_mm * np.array(found.filled.shape)
    return (float(low[0]), float(high[0]), float(low[1]), float(high[1]))


def _show(
    axes: Axes, shades: FloatArray, extent: tuple[float, float, float, float], name: str
) -> None:
    axes.imshow(np.swapaxes(shades, 0, 1), origin="lower", extent=extent, interpolation="nearest")
    axes.set_title(name, fontsize=9)
    axes.tick_params(labelsize=7)
    axes.set_xlabel("part x [mm]", fontsize=8)
    axes.set_ylabel("part y [mm]", fontsize=8)


def _keys(figure: Figure, found: AsBuiltComparison) -> None:
    names = found.materials[: found.design.fractions.shape[1]]
    if len(names) == 2:
        bar = figure.colorbar(
            ScalarMappable(Normalize(0, 1), colormaps[TWO_MATERIAL_COLOURMAP]),
            cax=figure.add_axes((0.10, 0.07, 0.40, 0.02)), orientation="horizontal")
        bar.set_label(f"volume fraction of {names[1]} (the rest is {names[0]})", fontsize=8)
    else:
        shades = material_colours(len(names))
        figure.legend(
            handles=[Patch(color=tuple(shade), label=name)
                     for name, shade in zip(names, shades, strict=True)],
            loc="lower left", bbox_to_anchor=(0.05, 0.0), ncols=6, fontsize=8, frameon=False)
        bar = None
    error = figure.colorbar(
        ScalarMappable(Normalize(0, _WORST), colormaps[_ERROR_COLOURMAP]),
        cax=figure.add_axes((0.69, 0.07, 0.15, 0.02)), orientation="horizontal", extend="max")
    error.set_label("error of a volume fraction", fontsize=8)
    for one in (bar, error):
        if one is not None:
            one.ax.tick_params(labelsize=7)
    figure.legend(handles=[Patch(color=_MISSING, label="missing"),
                           Patch(color=_SURPLUS, label="beside")],
                  loc="lower right", bbox_to_anchor=(0.98, 0.01), fontsize=8, frameon=False)
