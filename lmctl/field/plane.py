"""One plane of a part: a grid of nodes in it, and outlines as levels of values there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import contourpy
import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError


@dataclass(frozen=True)
class PlaneGrid:
    """A uniform grid of nodes in one plane.

    origin_mm : (x, y) of node [0, 0]
    pitch_mm : distance of neighbouring nodes, > 0
    shape : (ny, nx), number of nodes
    """

    origin_mm: tuple[float, float]
    pitch_mm: float
    shape: tuple[int, int]

    @property
    def x_mm(self) -> FloatArray:
        """(nx,) float64 [mm]"""
        return self.origin_mm[0] + self.pitch_mm * np.arange(self.shape[1], dtype=np.float64)

    @property
    def y_mm(self) -> FloatArray:
        """(ny,) float64 [mm]"""
        return self.origin_mm[1] + self.pitch_mm * np.arange(self.shape[0], dtype=np.float64)


def section_loops(
    values: NDArray[np.float32], grid: PlaneGrid, level: float = 0.0
) -> list[FloatArray]:
    """The outline of {values > level}: closed loops, the inside on the left.

    values : (ny, nx) float32, signed distance positive inside
    returns : loops (k, 2) float64 [mm], first point repeated last; outer loops run
        counter-clockwise, holes clockwise. Empty where nothing exceeds the level.
    raises : InputError where the inside reaches the edge of the grid, so that a loop would
        be left open, or where a value is not a number
    """
    return iso_loops(values, grid, [level])[0]


def iso_loops(
    distance: NDArray[np.float32], grid: PlaneGrid, levels: Iterable[float]
) -> list[list[FloatArray]]:
    """The loops of several levels, as `section_loops` gives them; one list a level.

    Loops are piecewise linear between grid lines; ones without area are left out.
    """
    levels = list(levels)
    _check_plane(distance, grid, min(levels, default=0.0))
    generator = contourpy.contour_generator(
        grid.x_mm, grid.y_mm, distance, name="serial", line_type=contourpy.LineType.Separate
    )
    return [_closed([np.asarray(line) for line in generator.lines(level)]) for level in levels]


def loop_area_mm2(loop: FloatArray) -> float:
    """Signed area of a closed loop (k, 2) [mm]: positive where it runs counter-clockwise."""
    x, y = loop[:, 0] - loop[0, 0], loop[:, 1] - loop[0, 1]
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def _check_plane(values: NDArray[np.float32], grid: PlaneGrid, level: float) -> None:
    where = f"plane of {grid.shape[1]} x {grid.shape[0]} nodes, pitch {grid.pitch_mm:g} mm"
    if values.shape != grid.shape:
        raise ValueError(f"values of shape {values.shape} on a plane of shape {grid.shape}")
    if np.isnan(values).any():
        raise InputError("the distance in a section is not a number somewhere", where=where,
                         hint="check the scan or mesh for damage, or give a larger pitch_mm")
    edge = max(values[0].max(), values[-1].max(), values[:, 0].max(), values[:, -1].max())
    if edge > level:
        raise InputError(
            "the part reaches the edge of its grid, so its outline would be left open",
            where=where,
            hint="give the grid at least two nodes of padding around the part",
        )


def _closed(lines: list[FloatArray]) -> list[FloatArray]:
    """Drop repeated points (a level met exactly at a node gives them) and loops without area."""
    loops = []
    for line in lines:
        keep = np.ones(len(line), dtype=bool)
        keep[1:] = np.any(line[1:] != line[:-1], axis=1)
        loop = line[keep]
        if len(loop) >= 4 and loop_area_mm2(loop) != 0.0:
            loops.append(loop)
    return loops
