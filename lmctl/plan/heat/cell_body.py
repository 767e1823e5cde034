"""A body in cells: what each holds, its temperature, and how well it conducts to its neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel

#: Cells hold thousands of kelvin to a thousandth; half as wide numbers are twice as fast.
CELL_FLOAT = np.float32
#: Cells that hold less are as slow as if they held so much: slivers at the edge of a bead [J/K].
LEAST_J_K = 1e-9


@dataclass
class CellBody:
    """Slabs of cells, [slab, y, x], with one slab and one column without content beyond each end.

    Slab 0 below the lowest has no content; its temperature and `up_W_K` are those of what the body
    rests on. Temperatures are counted from the table's, of which all begins: so what is far from
    the beam holds 0 exactly, and no heat is lost in rounding.

    n : slabs in use, 1 to n
    rise_K, volume_mm3, capacity_J_K : of each cell, its temperature above the table's
    inverse_K_J : one over its capacity, or over `LEAST_J_K`
    conductivity_mm3 : conductivity times volume [W mm²/K]
    cover : share of the cell's area that is covered, [0, 1]
    east_W_K, north_W_K, up_W_K : conductance to the next cell in x, in y, and above
    loss_W_K : to the surroundings
    dx_mm, dy_mm : widths of columns
    """

    n: int
    rise_K: FloatArray
    volume_mm3: FloatArray
    capacity_J_K: FloatArray
    inverse_K_J: FloatArray
    conductivity_mm3: FloatArray
    cover: FloatArray
    east_W_K: FloatArray
    north_W_K: FloatArray
    up_W_K: FloatArray
    loss_W_K: FloatArray
    dx_mm: FloatArray
    dy_mm: FloatArray

    def copy(self) -> CellBody:
        """The same body, to go on by itself."""
        return replace(self, **{
            name: getattr(self, name).copy() for name in self.__dataclass_fields__
            if name not in ("n", "dx_mm", "dy_mm")})

    def arrays(self) -> tuple[FloatArray, ...]:
        """What kernels change."""
        return (self.rise_K, self.volume_mm3, self.capacity_J_K, self.inverse_K_J,
                self.conductivity_mm3, self.cover, self.east_W_K, self.north_W_K, self.up_W_K,
                self.loss_W_K)


def empty_body(slabs: int, dx_mm: FloatArray, dy_mm: FloatArray) -> CellBody:
    """A body without content, with room for so many slabs."""
    shape = (slabs + 2, len(dy_mm), len(dx_mm))
    values: list[Any] = [np.zeros(shape, CELL_FLOAT) for _ in range(10)]
    return CellBody(0, *values, dx_mm=dx_mm, dy_mm=dy_mm)  # type: ignore[misc]


def connect_body(body: CellBody, loss_W_mm2_K: float) -> None:
    """Find all conductances anew, but those to what the body rests on, and inverse capacities."""
    np.divide(1.0, np.maximum(body.capacity_J_K, LEAST_J_K), out=body.inverse_K_J)
    connect_cells(
        body.volume_mm3, body.conductivity_mm3, body.cover, body.east_W_K, body.north_W_K,
        body.up_W_K, body.loss_W_K, body.dx_mm, body.dy_mm, body.n, loss_W_mm2_K)


@kernel
def connect_cells(
    volume: FloatArray, conductivity: FloatArray, cover: FloatArray,
    east: FloatArray, north: FloatArray, up: FloatArray, loss: FloatArray, dx: FloatArray,
    dy: FloatArray, n: int, loss_W_mm2_K: float,
) -> None:
    """All conductances of slabs 1 to n."""
    for k in range(1, n + 1):
        for j in range(1, volume.shape[1] - 1):
            for i in range(1, volume.shape[2] - 1):
                connect_cell(volume, conductivity, cover, east, north, up, loss, dx, dy, k, j, i,
                             loss_W_mm2_K)


@inner_kernel
def connect_cell(
    volume: FloatArray, conductivity: FloatArray, cover: FloatArray, east: FloatArray,
    north: FloatArray, up: FloatArray, loss: FloatArray, dx: FloatArray, dy: FloatArray,
    k: int, j: int, i: int, loss_W_mm2_K: float,
) -> None:
    """Conductances of one cell to those east, north and above, and its loss.

    Between two columns only the lesser thickness of both conducts, and between two slabs only the
    area that both cover: so no cell conducts more than it can hold, however little it is filled.
    """
    v = volume[k, j, i]
    if v <= 0.0:
        east[k, j, i] = north[k, j, i] = up[k, j, i] = loss[k, j, i] = 0.0
        return
    area = dx[i] * dy[j]
    thick = v / area
    own = conductivity[k, j, i] / v
    v_east, v_north, v_up = volume[k, j, i + 1], volume[k, j + 1, i], volume[k + 1, j, i]
    east[k, j, i] = north[k, j, i] = up[k, j, i] = 0.0
    if v_east > 0.0:
        thin = min(thick, v_east / (dx[i + 1] * dy[j]))
        other = conductivity[k, j, i + 1] / v_east
        east[k, j, i] = dy[j] * thin / (0.5 * dx[i] / own + 0.5 * dx[i + 1] / other)
    if v_north > 0.0:
        thin = min(thick, v_north / (dx[i] * dy[j + 1]))
        other = conductivity[k, j + 1, i] / v_north
        north[k, j, i] = dx[i] * thin / (0.5 * dy[j] / own + 0.5 * dy[j + 1] / other)
    covered = 0.0
    if v_up > 0.0:
        covered = min(cover[k, j, i], cover[k + 1, j, i])
        other = conductivity[k + 1, j, i] / v_up
        up[k, j, i] = area * covered / (
            0.5 * thick / cover[k, j, i] / own
            + 0.5 * v_up / (area * cover[k + 1, j, i]) / other)
    open_mm2 = area * (cover[k, j, i] - covered)
    open_mm2 += dy[j] * max(thick - v_east / (dx[i + 1] * dy[j]), 0.0)
    open_mm2 += dy[j] * max(thick - volume[k, j, i - 1] / (dx[i - 1] * dy[j]), 0.0)
    open_mm2 += dx[i] * max(thick - v_north / (dx[i] * dy[j + 1]), 0.0)
    open_mm2 += dx[i] * max(thick - volume[k, j - 1, i] / (dx[i] * dy[j - 1]), 0.0)
    loss[k, j, i] = loss_W_mm2_K * open_mm2


@inner_kernel
def conduct(
    t: FloatArray, t_new: FloatArray, inverse: FloatArray, east: FloatArray, north: FloatArray,
    up: FloatArray, loss: FloatArray, first: int, last: int, j0: int, j1: int, ambient_K: float,
    now: float, before: float, lasting_s: float,
) -> None:
    """One stage of a step, of slabs first to last, rows j0 to j1 − 1.

    t_new : temperatures two stages ago, and the new ones: now · t + before · t_new + lasting_s · dt
    Rows are gone through as one, columns without content included: they conduct nothing, and long
    loops are several times as fast.
    """
    ny, nx = t.shape[1], t.shape[2]
    own, new, i = t.reshape(-1), t_new.reshape(-1), inverse.reshape(-1)
    e, n, u, s = east.reshape(-1), north.reshape(-1), up.reshape(-1), loss.reshape(-1)
    surroundings, step_s = np.float32(ambient_K), np.float32(lasting_s)
    of_now, of_before = np.float32(now), np.float32(before)
    # unsigned indices are never counted from the end, which lets the loop run in vectors
    one, row, slab = np.uint64(1), np.uint64(nx), np.uint64(ny * nx)
    for k in range(first, last + 1):
        for m in range(np.uint64((k * ny + j0) * nx), np.uint64((k * ny + j1) * nx)):
            here = own[m]
            gain = (e[m] * (own[m + one] - here) + e[m - one] * (own[m - one] - here)
                    + n[m] * (own[m + row] - here) + n[m - row] * (own[m - row] - here)
                    + u[m] * (own[m + slab] - here) + u[m - slab] * (own[m - slab] - here)
                    + s[m] * (surroundings - here))
            new[m] = of_now * here + of_before * new[m] + step_s * gain * i[m]
