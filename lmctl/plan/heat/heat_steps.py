"""Advance a part's temperature in time: beads are deposited, heat spreads, places are read.

Heat conduction in finite volumes, explicit in time: T += dt/C · Σ G (T_neighbour − T)
(S. V. Patankar, Numerical Heat Transfer and Fluid Flow, 1980, chapter 4).

A bead's heat and material are divided over the four nearest columns, on two lines within its
strip, so that strips side by side fill columns evenly. Places are read from the four nearest
columns. This blurs what is nearer than a cell: places are meant to be read when the beam is some
beads away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.heat.cell_body import conduct, connect_cell

#: Columns that a bead has filled are connected anew every so many steps: it takes most of the time.
CONNECT_EVERY = 3


@dataclass(frozen=True)
class BeadLines:
    """Lines of bead in order of time; n lines.

    start_mm, end_mm : (n, 2) float64; start_s, end_s : (n,) float64
    strip_mm : (n,) float64, width that is filled
    power_W : (n,) float64, absorbed
    volume_mm3, capacity_J_K, conductivity_mm3 : (n,) float64, of what the line deposits
        [mm³, J/K, W mm²/K]
    """

    start_mm: FloatArray
    end_mm: FloatArray
    start_s: FloatArray
    end_s: FloatArray
    strip_mm: FloatArray
    power_W: FloatArray
    volume_mm3: FloatArray
    capacity_J_K: FloatArray
    conductivity_mm3: FloatArray

    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What kernels read: (n, 5) places, (n, 2) times, (n, 4) amounts."""
        return (np.column_stack([self.start_mm, self.end_mm, self.strip_mm]),
                np.column_stack([self.start_s, self.end_s]),
                np.column_stack([self.power_W, self.volume_mm3, self.capacity_J_K,
                                 self.conductivity_mm3]))


    def part(self, first: int, last: int, later_s: float) -> BeadLines:
        """Lines first to last − 1, so much later."""
        some = slice(first, last)
        return BeadLines(
            self.start_mm[some], self.end_mm[some], self.start_s[some] + later_s,
            self.end_s[some] + later_s, self.strip_mm[some], self.power_W[some],
            self.volume_mm3[some], self.capacity_J_K[some], self.conductivity_mm3[some])


#: While the beam is off.
NO_LINES = BeadLines(*(np.zeros((0, 2)) for _ in range(2)), *(np.zeros(0) for _ in range(7)))


@kernel
def advance_cells(
    t: FloatArray, t_new: FloatArray, volume: FloatArray, capacity: FloatArray,
    conductivity: FloatArray, cover: FloatArray, east: FloatArray, north: FloatArray,
    up: FloatArray, loss: FloatArray, dx: FloatArray, dy: FloatArray, n: int, part_from: int,
    box: IndexArray, cover_before: FloatArray, volume_before: FloatArray,
    deep_t: FloatArray, deep_new: FloatArray, deep_capacity: FloatArray, deep_east: FloatArray,
    deep_north: FloatArray, deep_up: FloatArray, deep_loss: FloatArray, deep_n: int,
    coarse_x: IndexArray, coarse_y: IndexArray,
    origin: FloatArray, cell_mm: float, layer_mm: float, loss_W_mm2_K: float, ambient_C: float,
    now_s: float, until_s: float, step_s: float, deep_every: int,
    places: FloatArray, times: FloatArray, amounts: FloatArray,
    read_s: FloatArray, read_mm: FloatArray, read_C: FloatArray,
) -> None:
    """Advance the fine cells and the deep ones from `now_s` to `until_s`, in equal steps.

    t .. loss : arrays of `CellBody` of the fine cells, slabs 1 to n; those from `part_from` on hold
        part only; t_new : workspace of the same shape, halo equal
    box : (4,) columns j0, j1, i0, i1 that may hold the part
    cover_before, volume_before : (ny, nx) of the top slab when its last layer began
    deep_t .. deep_loss : of the deep cells, which slab 1 rests on
    step_s : wanted; deep_every : fine steps to one of the deep cells
    places, times, amounts : of `BeadLines`, rising in time
    read_s : (r,) rising; read_mm : (r, 2); read_C : (r,) is written, where the time is reached
    """
    steps = max(1, int(np.ceil((until_s - now_s) / step_s - 1e-9)))
    dt = (until_s - now_s) / steps
    ny, nx = volume.shape[1], volume.shape[2]
    gain = np.zeros_like(up[0])  # into the deep cells, by fine column, sum over steps [W]
    a, b, deep_a, deep_b = t, t_new, deep_t, deep_new
    line, read, since = 0, 0, 0
    touched = np.empty(4, np.int64)
    forget(touched)
    for step in range(steps):
        begin = now_s + step * dt
        end = begin + dt
        while read < len(read_s) and read_s[read] < end:  # never after the beam has gone on
            read_C[read] = read_place(a, cover, cover_before, n, origin, cell_mm, box,
                                      read_mm[read, 0], read_mm[read, 1])
            read += 1
        while line < len(times) and times[line, 1] <= begin:
            line += 1
        other = line
        while other < len(times) and times[other, 0] < end:
            lasting = times[other, 1] - times[other, 0]
            u0 = max(0.0, (begin - times[other, 0]) / max(lasting, 1e-9))
            u1 = min(1.0, (end - times[other, 0]) / max(lasting, 1e-9))
            if u1 > u0:
                middle = 0.5 * (u0 + u1)
                along_x = places[other, 2] - places[other, 0]
                along_y = places[other, 3] - places[other, 1]
                aside = places[other, 4] / 4 / max(np.hypot(along_x, along_y), 1e-9)
                half = 0.5 * (u1 - u0)
                for side in (-aside, aside):  # so that strips side by side fill evenly
                    deposit(a, volume, capacity, conductivity, cover, dx, dy, n, box, cover_before,
                            volume_before, origin, cell_mm, layer_mm, ambient_C,
                            places[other, 0] + middle * along_x + side * along_y,
                            places[other, 1] + middle * along_y - side * along_x,
                            amounts[other, 0] * lasting * half, amounts[other, 1] * half,
                            amounts[other, 2] * half, amounts[other, 3] * half, touched)
            other += 1
        if touched[1] >= 0 and (step % CONNECT_EVERY == 0 or step == steps - 1):
            connect_touched(volume, conductivity, cover, east, north, up, loss, dx, dy, n,
                            loss_W_mm2_K, touched)
        for j in range(1, ny - 1):
            for i in range(1, nx - 1):
                gain[j, i] += up[0, j, i] * (a[1, j, i] - a[0, j, i])
        conduct(a, b, capacity, east, north, up, loss, 1, part_from - 1, 1, ny - 1, ambient_C, dt)
        conduct(a, b, capacity, east, north, up, loss, part_from, n, box[0], box[1], ambient_C, dt)
        a, b = b, a
        since += 1
        if since == deep_every or step == steps - 1:
            step_deep_cells(a, b, gain, dt, coarse_x, coarse_y, deep_a, deep_b, deep_capacity,
                            deep_east, deep_north, deep_up, deep_loss, deep_n, ambient_C,
                            since * dt)
            deep_a, deep_b = deep_b, deep_a
            since = 0
    while read < len(read_s) and read_s[read] <= until_s + 1e-6:
        read_C[read] = read_place(a, cover, cover_before, n, origin, cell_mm, box,
                                  read_mm[read, 0], read_mm[read, 1])
        read += 1
    if steps % 2 == 1:
        t[:n + 1] = t_new[:n + 1]
    deep_t[:] = deep_a


@inner_kernel
def step_deep_cells(
    a: FloatArray, b: FloatArray, gain: FloatArray, dt: float, coarse_x: IndexArray,
    coarse_y: IndexArray, t: FloatArray, t_new: FloatArray, capacity: FloatArray, east: FloatArray,
    north: FloatArray, up: FloatArray, loss: FloatArray, n: int, ambient_C: float, lasting_s: float,
) -> None:
    """Give the deep cells the heat that came down, advance them, and tell the fine cells."""
    ny, nx = gain.shape
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            jj, ii = coarse_y[j], coarse_x[i]
            if gain[j, i] != 0.0:
                t[n, jj, ii] += gain[j, i] * dt / max(capacity[n, jj, ii], 1e-9)
                gain[j, i] = 0.0
    conduct(t, t_new, capacity, east, north, up, loss, 1, n, 1, t.shape[1] - 1, ambient_C,
            lasting_s)
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            a[0, j, i] = b[0, j, i] = t_new[n, coarse_y[j], coarse_x[i]]


@inner_kernel
def deposit(
    t: FloatArray, volume: FloatArray, capacity: FloatArray, conductivity: FloatArray,
    cover: FloatArray, dx: FloatArray, dy: FloatArray, n: int, box: IndexArray,
    cover_before: FloatArray, volume_before: FloatArray, origin: FloatArray, cell_mm: float,
    layer_mm: float, ambient_C: float, x: float, y: float, energy_J: float, volume_mm3: float,
    capacity_J_K: float, conductivity_mm3: float, touched: IndexArray,
) -> None:
    """Add material and heat at a place, divided over the four nearest columns of the top slab."""
    u, v = (x - origin[0]) / cell_mm - 0.5, (y - origin[1]) / cell_mm - 0.5
    i0, j0 = int(np.floor(u)), int(np.floor(v))
    u, v = u - i0, v - j0
    for dj in range(2):
        for di in range(2):
            share = (v if dj else 1 - v) * (u if di else 1 - u)
            j = min(max(box[0] + j0 + dj, box[0]), box[1] - 1)
            i = min(max(box[2] + i0 + di, box[2]), box[3] - 1)
            if share <= 0.0:
                continue
            before = float(capacity[n, j, i])
            added = share * capacity_J_K
            t[n, j, i] = (before * t[n, j, i] + added * ambient_C + share * energy_J) / (
                before + added)
            capacity[n, j, i] = before + added
            volume[n, j, i] += share * volume_mm3
            conductivity[n, j, i] += share * conductivity_mm3
            new = (volume[n, j, i] - volume_before[j, i]) / (dx[i] * dy[j] * layer_mm)
            cover[n, j, i] = max(cover_before[j, i], min(new, 1.0))
            touched[0], touched[1] = min(touched[0], j), max(touched[1], j)
            touched[2], touched[3] = min(touched[2], i), max(touched[3], i)


@inner_kernel
def connect_touched(
    volume: FloatArray, conductivity: FloatArray, cover: FloatArray, east: FloatArray,
    north: FloatArray, up: FloatArray, loss: FloatArray, dx: FloatArray, dy: FloatArray, n: int,
    loss_W_mm2_K: float, touched: IndexArray,
) -> None:
    """Connect the columns of the top slab that have changed, and forget which they were."""
    for j in range(touched[0] - 1, touched[1] + 2):
        for i in range(touched[2] - 1, touched[3] + 2):
            connect_cell(volume, conductivity, cover, east, north, up, loss, dx, dy, n, j, i,
                         loss_W_mm2_K)
    for j in range(touched[0], touched[1] + 1):
        for i in range(touched[2], touched[3] + 1):
            connect_cell(volume, conductivity, cover, east, north, up, loss, dx, dy, n - 1, j, i,
                         loss_W_mm2_K)
    forget(touched)


@inner_kernel
def forget(touched: IndexArray) -> None:
    """No column is touched: rows and columns (4,) from more to less."""
    touched[0], touched[1], touched[2], touched[3] = 1 << 30, -1, 1 << 30, -1


@inner_kernel
def read_place(
    t: FloatArray, cover: FloatArray, cover_before: FloatArray, n: int,
    origin: FloatArray, cell_mm: float, box: IndexArray, x: float, y: float,
) -> float:
    """Temperature at a place of the surface that the layer is deposited on."""
    u, v = (x - origin[0]) / cell_mm - 0.5, (y - origin[1]) / cell_mm - 0.5
    i0, j0 = int(np.floor(u)), int(np.floor(v))
    u, v = u - i0, v - j0
    total, weights = 0.0, 0.0
    for dj in range(2):
        for di in range(2):
            share = (v if dj else 1 - v) * (u if di else 1 - u)
            j = min(max(box[0] + j0 + dj, box[0]), box[1] - 1)
            i = min(max(box[2] + i0 + di, box[2]), box[3] - 1)
            top, below = cover_before[j, i], cover[n - 1, j, i]
            below = max(below - top, 0.0)
            held = top + below
            if held > 0.0 and share > 0.0:
                total += share * (top * t[n, j, i] + below * t[n - 1, j, i])
                weights += share * held
    return total / weights if weights > 0.0 else np.nan
