"""The material field over a section, on a raster: one number a node along its direction of change.

Mixtures of a layer mostly lie on a line in composition space, from one recipe to another. The
*grade* of a mixture is its place along that line, scaled so that a step of 1 in grade is a step of
at most 1 in any volume fraction. Lines of equal grade are lines of equal mixture, exactly so where
two powders are mixed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import contourpy
import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.field.plane import PlaneGrid
from lmctl.plan.geometry.section_raster import SectionRaster

#: Volume fractions at points (n, 2) [mm] of the section: (n, materials), rows summing to 1.
MixtureAt = Callable[[FloatArray], FloatArray]

#: Between nodes that differ by more, a line of equal grade is looked for in the field itself,
_STEEP = 0.003
#: until it has the grade within this, or for so many rounds,
_FOUND = 3e-4
_ROUNDS = 6
#: and by halving where it differs by so much.
_JUMP = 0.05
#: Components of the direction of change of which the lesser is this part of the greater count as
#: equal.
_AS_LARGE = 0.9


@dataclass(frozen=True)
class MixtureMap:
    """Grade at the nodes of a section's raster.

    grid : of the nodes; inside : (ny, nx) bool
    grade : (ny, nx) float64, and fractions : (ny, nx, materials) float64; beyond the outline those
        of the nearest node inside
    middle, direction : (materials,) float64, grade = (fractions − middle) · direction
    fractions_at : the part's own field
    """

    grid: PlaneGrid
    grade: FloatArray
    fractions: FloatArray
    inside: BoolArray
    middle: FloatArray
    direction: FloatArray
    fractions_at: MixtureAt

    @property
    def lowest(self) -> float:
        return float(self.grade[self.inside].min())

    @property
    def highest(self) -> float:
        return float(self.grade[self.inside].max())

    def grade_at(self, points_mm: FloatArray) -> FloatArray:
        """Grade of the part's field at points (n, 2) [mm], (n,)."""
        return self.grade_of(self.fractions_at(points_mm))

    def grade_of(self, fractions: FloatArray) -> FloatArray:
        """Grade of mixtures (n, materials), (n,)."""
        return np.asarray((fractions - self.middle) @ self.direction)

    def lines_of(self, level: float) -> list[FloatArray]:
        """Outlines of {grade < level} as the nodes have it: closed loops (k, 2) [mm]."""
        return _closed_lines(level - self.grade, self.grid)

    def below(self, levels: Sequence[float]) -> list[list[FloatArray]]:
        """Outlines of {grade < level} on the raster: closed loops (k, 2) [mm], a list a level.

        Where the field is steep they lie on the field's own line of that grade, within a 60th of
        a node, also where it jumps.
        """
        lines = [self.lines_of(level) for level in levels]
        every = [line for found in lines for line in found]
        if not every:
            return lines
        size = [len(line) for line in every]
        wanted = np.repeat(np.repeat(levels, [len(found) for found in lines]), size)
        moved = iter(np.split(self._refined(np.vstack(every), wanted), np.cumsum(size)[:-1]))
        result = [[next(moved) for _ in found] for found in lines]
        for found in result:
            for line in found:
                line[-1] = line[0]
        return result

    def _refined(self, points: FloatArray, levels: FloatArray) -> FloatArray:
        """Points (n, 2) on raster lines moved along them to where the field has the levels (n,)."""
        at = (points - np.array(self.grid.origin_mm)) / self.grid.pitch_mm
        ny, nx = self.grid.shape
        on_row = np.abs(at[:, 1] - np.round(at[:, 1])) <= np.abs(at[:, 0] - np.round(at[:, 0]))
        low = np.where(on_row[:, None], np.column_stack([np.floor(at[:, 0]), np.round(at[:, 1])]),
                       np.column_stack([np.round(at[:, 0]), np.floor(at[:, 1])])).astype(np.intp)
        low = np.clip(low, 0, [nx - 1, ny - 1])
        high = np.clip(low + np.where(on_row[:, None], [1, 0], [0, 1]), 0, [nx - 1, ny - 1])
        a, b = self.grade[low[:, 1], low[:, 0]], self.grade[high[:, 1], high[:, 0]]
        both = self.inside[low[:, 1], low[:, 0]] & self.inside[high[:, 1], high[:, 0]]
        steep = np.flatnonzero(
            both & (np.abs(a - b) > _STEEP) & ((a < levels) != (b < levels)))
        if len(steep) == 0:
            return points
        moved = points.copy()
        origin, pitch = np.array(self.grid.origin_mm), self.grid.pitch_mm
        moved[steep] = self._meeting(
            origin + low[steep] * pitch, origin + high[steep] * pitch, a[steep] - levels[steep],
            b[steep] - levels[steep], levels[steep])
        return moved

    def _meeting(
        self, p: FloatArray, q: FloatArray, off_p: FloatArray, off_q: FloatArray,
        levels: FloatArray,
    ) -> FloatArray:
        """Where the field has the levels between points p and q (n, 2), on either side of them.

        off_p, off_q : (n,) grade there less the level. False position; halving across a jump.
        """
        for _ in range(_ROUNDS):
            open_ = np.flatnonzero(np.minimum(np.abs(off_p), np.abs(off_q)) > _FOUND)
            if len(open_) == 0:
                break
            a, b = off_p[open_], off_q[open_]
            share = np.where(np.abs(a - b) > _JUMP, 0.5, a / (a - b))
            at = p[open_] + np.clip(share, 0.05, 0.95)[:, None] * (q[open_] - p[open_])
            off = self.grade_at(at) - levels[open_]
            same = (off < 0) == (a < 0)
            p[open_] = np.where(same[:, None], at, p[open_])
            q[open_] = np.where(same[:, None], q[open_], at)
            off_p[open_] = np.where(same, off, a)
            off_q[open_] = np.where(same, b, off)
        share = np.where(np.abs(off_p - off_q) > _JUMP, 0.5,
                         off_p / np.where(off_p == off_q, 1.0, off_p - off_q))
        return np.asarray(p + np.clip(share, 0, 1)[:, None] * (q - p))


def mixture_map(
    raster: SectionRaster, fractions_at: MixtureAt, padding_mm: float
) -> MixtureMap | None:
    """The map of a section; None where no node of the raster lies inside.

    padding_mm : how far beyond the raster it reaches, each side
    """
    grid, inside = _padded(raster.grid, raster.depth_mm > 0, padding_mm)
    j, i = np.nonzero(inside)
    if len(j) == 0:
        return None
    found = fractions_at(np.column_stack([grid.x_mm[i], grid.y_mm[j]]))
    middle, direction = _main_direction(found)
    rows, columns = nearest_nodes(inside)
    fractions = np.zeros((*grid.shape, found.shape[1]))
    fractions[inside] = found
    fractions = fractions[rows, columns]
    return MixtureMap(grid, (fractions - middle) @ direction, fractions, inside, middle, direction,
                      fractions_at)


def nearest_nodes(chosen: BoolArray) -> tuple[IntArray, IntArray]:
    """Row and column of the chosen node nearest to each node, (ny, nx) each. chosen : (ny, nx)"""
    from scipy.ndimage import distance_transform_edt  # late: it loads as long as a small part plans

    rows, columns = distance_transform_edt(~chosen, return_distances=False, return_indices=True)
    return rows, columns


def _padded(
    grid: PlaneGrid, inside: BoolArray, padding_mm: float
) -> tuple[PlaneGrid, BoolArray]:
    """The grid with more nodes on each side, none of them inside."""
    more = int(np.ceil(padding_mm / grid.pitch_mm))
    origin = (grid.origin_mm[0] - more * grid.pitch_mm, grid.origin_mm[1] - more * grid.pitch_mm)
    return (PlaneGrid(origin, grid.pitch_mm, (grid.shape[0] + 2 * more, grid.shape[1] + 2 * more)),
            np.pad(inside, more))


def _main_direction(fractions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle of mixtures (n, m), and the direction in which they differ most, scaled for grade."""
    middle = fractions.mean(axis=0)
    spread = fractions - middle
    if np.abs(spread).max() < 1e-9:
        return middle, np.zeros(fractions.shape[1])
    _, axes = np.linalg.eigh(spread.T @ spread)
    axis = axes[:, -1]
    # of two powders both components are as large but for rounding: every layer takes the same one
    largest = np.flatnonzero(np.abs(axis) > _AS_LARGE * np.abs(axis).max())[-1]
    axis = axis * np.sign(axis[largest])
    return middle, np.asarray(axis * np.abs(axis).max())


def _closed_lines(values: FloatArray, grid: PlaneGrid) -> list[FloatArray]:
    """Outlines of {values > 0}, closed along the edge of the grid where they reach it."""
    ny, nx = grid.shape
    least = min(float(values.min()), -1.0)
    padded = np.full((ny + 2, nx + 2), least)
    padded[1:-1, 1:-1] = values
    x = np.concatenate([[grid.x_mm[0] - grid.pitch_mm], grid.x_mm, [grid.x_mm[-1] + grid.pitch_mm]])
    y = np.concatenate([[grid.y_mm[0] - grid.pitch_mm], grid.y_mm, [grid.y_mm[-1] + grid.pitch_mm]])
    generator = contourpy.contour_generator(
        x, y, padded, name="serial", line_type=contourpy.LineType.Separate)
    lines = [np.asarray(line, dtype=np.float64) for line in generator.lines(0.0)]
    return [line for line in lines if len(line) >= 4 and (line[0] == line[-1]).all()]
