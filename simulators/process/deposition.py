"""Lays a bead piece by piece on a field of columns, and melts it into what lies below.

A piece of the path is a slice across it, two voxels long. The powder it catches fills
the slice up to a crown: a parabola across the bead, whose area on a flat surface is the volume over
the length. The crown stands as high above the surface as the volume needs, and nothing is taken
away where the surface is higher. So a bead on a plate is the parabola, a bead on a bead grows
straight up, and a valley between two beads fills first. A column far below the mean under and
around the pool is not reached: the bead hangs there, with a void below.

All volume that a column gets in one pass of the pool is gathered first. When the pool comes by
again, or at the end, it is mixed with what the pool melted of the column below, δ/(1 − δ) of it,
and becomes part of the column's voxels. Volumes are added and moved, so none is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulators.array_types import FloatArray

#: Slices of the path in a voxel's width, and strips of a slice.
SLICES_PER_VOXEL = 2
#: The pool spreads a slice over so many rows along the path, so many slices apart: no whole number,
#: so that rows of all slices together lie evenly.
_ROWS = 8
_ROW_SPACING = 0.5625
#: A column deeper than so many bead widths below the mean under and around the pool is not reached.
_REACH_WIDTHS = 1.0
#: The surface around the pool is looked at in so many points on its rim.
_RIM_POINTS = 8
#: The pool comes by again once it has gone so many bead widths.
_PASS_WIDTHS = 0.5

_MOST_STRIPS = 512

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile a function, once, with numpy's division."""
    compiled: Any = njit(cache=True, error_model="numpy")(function)
    return cast(Function, compiled)


@kernel
def lay_pieces(
    place: FloatArray, direction: FloatArray, length: FloatArray, advance: FloatArray,
    width: FloatArray, remelt_ratio: FloatArray, volume: FloatArray, falloff: FloatArray,
    best_standoff: float, cell: float, height: float, bottom: float, top: FloatArray,
    voxels: FloatArray, caught: FloatArray, surface: FloatArray,
) -> bool:
    """Lay n pieces of k powders on columns of (nx, ny); returns whether some rose above the grid.

    place : (n, 3) x, y from the grid's corner, z of the tool point in machine coordinates [mm]
    direction : (n, 2) unit vectors; length : (n,) of the piece; advance : (n,) way of the nozzle
        since the piece before
    width : (n,) of the bead; remelt_ratio : (n,) δ/(1 − δ)
    volume : (n, k) deposited at the best standoff [mm³]; falloff : (k,) [mm], 0: none
    cell, height : of a voxel; bottom : z of the grid [mm]
    top : (nx, ny) z of the surface; voxels : (nx, ny, nz, k + 1) [mm³], the substrate last; both
        are changed
    caught : (n, k) receives the volume that stayed; surface : (n,) the surface below each piece
    """
    n, k = volume.shape
    nx, ny = top.shape
    base = top.copy()
    bridged = np.zeros((nx, ny), np.bool_)
    seen = np.full((nx, ny), -1e300)
    fresh = np.zeros((nx, ny, k + 1))
    molten = np.zeros((nx, ny))
    area = cell * cell
    points = _ROWS * _MOST_STRIPS
    floor, needed, crown_share = np.empty(points), np.empty(points), np.empty(points)
    column = np.empty((points, 2), np.int64)
    row_step = _ROW_SPACING * cell / SLICES_PER_VOXEL
    way = 0.0
    overflow = False
    for i in range(n):
        way += advance[i]
        strips = min(_MOST_STRIPS, max(4, int(np.ceil(SLICES_PER_VOXEL * width[i] / cell))))
        strip = width[i] / strips
        reach = _REACH_WIDTHS * width[i]
        apart = _PASS_WIDTHS * width[i]
        # the surface under the pool
        mean = 0.0
        count = 0
        for r in range(_ROWS):
            ahead = (r - 0.5 * (_ROWS - 1)) * row_step
            shift = (((3 * r) % _ROWS + 0.5) / _ROWS - 0.5) * strip
            for j in range(strips):
                across = (j + 0.5) * strip - 0.5 * width[i] + shift
                dx, dy = direction[i, 0], direction[i, 1]
                a = int((place[i, 0] + ahead * dx - across * dy) / cell)
                b = int((place[i, 1] + ahead * dy + across * dx) / cell)
                off_x = (a + 0.5) * cell - place[i, 0]
                off_y = (b + 0.5) * cell - place[i, 1]
                u = 2.0 * (off_y * dx - off_x * dy) / width[i]
                if u * u > 1.0:
                    continue  # most of the column lies beside the bead
                column[count, 0], column[count, 1] = a, b
                crown_share[count] = 1.0 - u * u
                here = top[a, b] if way - seen[a, b] > apart else base[a, b]
                floor[count] = here
                mean += here
                count += 1
        rim, rim_mean = np.empty(_RIM_POINTS), 0.0
        for j in range(_RIM_POINTS):
            angle = 2.0 * np.pi * j / _RIM_POINTS
            a = int((place[i, 0] + 0.5 * width[i] * np.cos(angle)) / cell)
            b = int((place[i, 1] + 0.5 * width[i] * np.sin(angle)) / cell)
            rim[j] = top[a, b] if way - seen[a, b] > apart else base[a, b]
            rim_mean += rim[j] / _RIM_POINTS
        lowest = 0.5 * (mean / count + rim_mean) - reach
        under = _mean_above(floor, crown_share, count, lowest)
        if np.isnan(under):
            under = _mean_above(rim, np.ones(_RIM_POINTS), _RIM_POINTS, lowest)
        surface[i] = under
        patch = strip * length[i] / _ROWS
        # what is caught there
        total = 0.0
        for m in range(k):
            share = 1.0
            if falloff[m] > 0.0:
                off = (place[i, 2] - under - best_standoff) / falloff[m]
                share = np.exp(-off * off)
            caught[i, m] = volume[i, m] * share
            total += caught[i, m]
        if total <= 0.0:
            continue
        mean_rise = total / (length[i] * width[i])
        for j in range(count):
            if floor[j] < lowest:
                floor[j] = under - mean_rise
            needed[j] = floor[j] - 1.5 * mean_rise * crown_share[j]
        level = _level(needed, count, total / patch)
        # each point's part to its column
        for j in range(count):
            rise = level - needed[j]
            if rise <= 0.0:
                continue
            a, b = column[j, 0], column[j, 1]
            if way - seen[a, b] > apart:
                overflow |= _settle(a, b, base, bridged, fresh, molten, voxels, area, height,
                                    bottom)
                bridged[a, b] = floor[j] > top[a, b] + 1e-9
                base[a, b] = floor[j] if bridged[a, b] else top[a, b]
                top[a, b] = base[a, b]
            seen[a, b] = way
            gained = rise * patch
            for m in range(k):
                fresh[a, b, m] += gained * caught[i, m] / total
            molten[a, b] += gained * remelt_ratio[i]
            top[a, b] += gained / area
    for a in range(nx):
        for b in range(ny):
            overflow |= _settle(a, b, base, bridged, fresh, molten, voxels, area, height, bottom)
    return overflow


@kernel
def _mean_above(values: FloatArray, weights: FloatArray, n: int, lowest: float) -> float:
    """Weighted mean of those of values[:n] that are not below; NaN where all are."""
    total, weight = 0.0, 0.0
    for j in range(n):
        if values[j] >= lowest:
            total += weights[j] * values[j]
            weight += weights[j]
    return float(total / weight)


@kernel
def _level(needed: FloatArray, n: int, wanted: float) -> float:
    """The level to which wells of depths needed[:n], of area 1, are filled by so much."""
    level, filled = np.inf, n + 1
    while True:
        held, below = 0.0, 0
        for i in range(n):
            if needed[i] <= level:
                held += needed[i]
                below += 1
        if below == 0 or below >= filled:
            return float(level)
        level, filled = (wanted + held) / below, below


@kernel
def _settle(
    a: int, b: int, base: FloatArray, bridged: NDArray[Any], fresh: FloatArray,
    molten: FloatArray, voxels: FloatArray, area: float, height: float, bottom: float,
) -> bool:
    """Mix what a column got in a pass with what was melted below it. Returns whether it is too
    high for the grid."""
    k = fresh.shape[2]
    nz = voxels.shape[2]
    total = 0.0
    for m in range(k):
        total += fresh[a, b, m]
    if total <= 0.0:
        return False
    from_z = base[a, b]
    if not bridged[a, b]:
        left = molten[a, b]
        v = min(nz - 1, int((from_z - bottom) / height - 1e-9))
        while left > 0.0 and v >= 0:
            held = 0.0
            for m in range(k):
                held += voxels[a, b, v, m]
            if held <= 0.0:
                break
            part = min(1.0, left / held)
            for m in range(k):
                taken = part * voxels[a, b, v, m]
                voxels[a, b, v, m] -= taken
                fresh[a, b, m] += taken
            total += part * held
            from_z -= part * held / area
            left -= part * held
            v -= 1
    to_z = from_z + total / area
    v = max(0, int((from_z - bottom) / height))
    low = from_z
    while low < to_z and v < nz:
        high = min(to_z, bottom + (v + 1) * height)
        if v == nz - 1:
            high = to_z
        if high > low:
            for m in range(k):
                voxels[a, b, v, m] += fresh[a, b, m] * (high - low) / (to_z - from_z)
            low = high
        v += 1
    for m in range(k):
        fresh[a, b, m] = 0.0
    molten[a, b] = 0.0
    return bool(to_z > bottom + nz * height + 1e-9)
