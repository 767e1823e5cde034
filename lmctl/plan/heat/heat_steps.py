"""Advance a part's temperature in time: beads are deposited, heat spreads, places are read.

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
from lmctl.plan.heat.cell_body import LEAST_J_K, connect_cell
from lmctl.plan.heat.heat_stages import step_deep_cells, step_fine_cells

#: What a step deposits, its cells have from the step's begin on, so what was read at its begin
#: counts for so much of the step later.
_READ_LATER = 0.5


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


    def divided(self, into: IndexArray) -> BeadLines:
        """Each line as so many equal ones, (n,), one after the other."""
        line = np.repeat(np.arange(len(into)), into)
        begins = (np.arange(len(line)) - np.repeat(np.cumsum(into) - into, into)) / into[line]
        ends = begins + 1 / into[line]

        def between(start: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
            return np.asarray(start + share * (end - start))

        start_mm, end_mm, start_s, end_s = (
            column[line] for column in (self.start_mm, self.end_mm, self.start_s, self.end_s))
        return BeadLines(
            between(start_mm, end_mm, begins[:, None]), between(start_mm, end_mm, ends[:, None]),
            between(start_s, end_s, begins), between(start_s, end_s, ends), self.strip_mm[line],
            self.power_W[line], *(amount[line] / into[line] for amount in (
                self.volume_mm3, self.capacity_J_K, self.conductivity_mm3)))

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
    fine: tuple[FloatArray, ...], fine_new: FloatArray, deep: tuple[FloatArray, ...],
    deep_new: FloatArray, dx: FloatArray, dy: FloatArray, n: int, deep_n: int, part_from: int,
    box: IndexArray, cover_before: FloatArray, volume_before: FloatArray, coarse_x: IndexArray,
    coarse_y: IndexArray, origin: FloatArray, cell_mm: float, layer_mm: float,
    loss_W_mm2_K: float, ambient_K: float, now_s: float, until_s: float, step_s: float,
    stages: int, deep_stages: int, places: FloatArray, times: FloatArray, amounts: FloatArray,
    read_s: FloatArray, read_mm: FloatArray, read_K: FloatArray,
) -> None:
    """Advance the fine cells and the deep ones from `now_s` to `until_s`, in equal steps.

    fine, deep : `CellBody.arrays` of the fine cells, slabs 1 to n, and of those that slab 1 rests
        on, 1 to deep_n; fine slabs from `part_from` on hold part only
    fine_new, deep_new : workspace as great as their temperatures
    box : (4,) columns j0, j1, i0, i1 that may hold the part
    cover_before, volume_before : (ny, nx) of the top slab when its last layer began
    step_s : no step is longer; stages, deep_stages : of each step, enough for `stages_of`
    places, times, amounts : of `BeadLines`, rising in time
    read_s : (r,) rising; read_mm : (r, 2); read_K : (r,) is written, where the time is reached
    All temperatures count from the table's.
    """
    t, volume, capacity, inverse, conductivity, cover, east, north, up, loss = fine
    steps = max(1, int(np.ceil((until_s - now_s) / step_s - 1e-9)))
    dt = (until_s - now_s) / steps
    went_J = np.zeros((2, *up.shape[1:]), up.dtype)  # from the deep cells to the fine ones
    former = np.empty((2, *up.shape[1:]), up.dtype)
    line, read = 0, 0
    touched = np.empty(4, np.int64)
    forget(touched)
    for step in range(steps):
        begin = now_s + step * dt
        end = begin + dt
        while read < len(read_s) and read_s[read] < end:  # never after the beam has gone on
            read_K[read] = read_place(t[n], t[n - 1], cover[n - 1], cover_before, origin, cell_mm,
                                      box, read_mm[read, 0], read_mm[read, 1])
            if step > 0:
                was = read_place(former[1], former[0], cover[n - 1], cover_before, origin, cell_mm,
                                 box, read_mm[read, 0], read_mm[read, 1])
                read_K[read] += (read_K[read] - was) * (
                    max(read_s[read] - begin, 0.0) / dt - _READ_LATER)
            read += 1
        former[0], former[1] = t[n - 1], t[n]
        while line < len(times) and times[line, 1] <= begin:
            line += 1
        other = line
        while other < len(times) and times[other, 0] < end:
            lasting = times[other, 1] - times[other, 0]
            u0 = max(0.0, (begin - times[other, 0]) / max(lasting, 1e-9))
            u1 = min(1.0, (end - times[other, 0]) / max(lasting, 1e-9))
            if u1 > u0:
                deposit_line(t, volume, capacity, inverse, conductivity, cover, dx, dy, n, box,
                             cover_before, volume_before, origin, cell_mm, layer_mm, ambient_K,
                             places[other], amounts[other], lasting, u0, u1, touched)
            other += 1
        if touched[1] >= 0:
            connect_touched(volume, conductivity, cover, east, north, up, loss, dx, dy, n,
                            loss_W_mm2_K, touched)
        step_fine_cells(fine, fine_new, n, part_from, box, ambient_K, dt, stages, went_J)
        step_deep_cells(deep, deep_new, deep_n, went_J[0], t[0], coarse_x, coarse_y, ambient_K, dt,
                        deep_stages)
    while read < len(read_s) and read_s[read] <= until_s + 1e-6:
        read_K[read] = read_place(t[n], t[n - 1], cover[n - 1], cover_before, origin, cell_mm, box,
                                  read_mm[read, 0], read_mm[read, 1])
        read += 1


@inner_kernel
def deposit_line(
    t: FloatArray, volume: FloatArray, capacity: FloatArray, inverse: FloatArray,
    conductivity: FloatArray, cover: FloatArray, dx: FloatArray, dy: FloatArray, n: int,
    box: IndexArray, cover_before: FloatArray, volume_before: FloatArray, origin: FloatArray,
    cell_mm: float, layer_mm: float, ambient_K: float, place: FloatArray, amount: FloatArray,
    lasting_s: float, u0: float, u1: float, touched: IndexArray,
) -> None:
    """Deposit what lies between two shares of a line, in pieces no longer than half a cell."""
    along_x, along_y = place[2] - place[0], place[3] - place[1]
    length = np.hypot(along_x, along_y)
    aside = place[4] / 4 / max(length, 1e-9)
    pieces = max(1, int(np.ceil((u1 - u0) * length / (0.5 * cell_mm))))
    half = 0.5 * (u1 - u0) / pieces
    for piece in range(pieces):
        middle = u0 + (2 * piece + 1) * half
        for side in (-aside, aside):  # so that strips side by side fill evenly
            deposit(t, volume, capacity, inverse, conductivity, cover, dx, dy, n, box, cover_before,
                    volume_before, origin, cell_mm, layer_mm, ambient_K,
                    place[0] + middle * along_x + side * along_y,
                    place[1] + middle * along_y - side * along_x,
                    amount[0] * lasting_s * half, amount[1] * half, amount[2] * half,
                    amount[3] * half, touched)


@inner_kernel
def deposit(
    t: FloatArray, volume: FloatArray, capacity: FloatArray, inverse: FloatArray,
    conductivity: FloatArray, cover: FloatArray, dx: FloatArray, dy: FloatArray, n: int,
    box: IndexArray, cover_before: FloatArray, volume_before: FloatArray, origin: FloatArray,
    cell_mm: float, layer_mm: float, ambient_K: float, x: float, y: float, energy_J: float,
    volume_mm3: float, capacity_J_K: float, conductivity_mm3: float, touched: IndexArray,
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
            t[n, j, i] = (before * t[n, j, i] + added * ambient_K + share * energy_J) / (
                before + added)
            capacity[n, j, i] = before + added
            inverse[n, j, i] = 1.0 / max(before + added, LEAST_J_K)
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
    top: FloatArray, below: FloatArray, cover: FloatArray, cover_before: FloatArray,
    origin: FloatArray, cell_mm: float, box: IndexArray, x: float, y: float,
) -> float:
    """Temperature at a place of the surface that the layer is deposited on.

    top, below : (ny, nx) temperatures of the two top slabs; cover : of the lower one
    """
    u, v = (x - origin[0]) / cell_mm - 0.5, (y - origin[1]) / cell_mm - 0.5
    i0, j0 = int(np.floor(u)), int(np.floor(v))
    u, v = u - i0, v - j0
    total, weights = 0.0, 0.0
    for dj in range(2):
        for di in range(2):
            share = (v if dj else 1 - v) * (u if di else 1 - u)
            j = min(max(box[0] + j0 + dj, box[0]), box[1] - 1)
            i = min(max(box[2] + i0 + di, box[2]), box[3] - 1)
            upper = cover_before[j, i]
            lower = max(cover[j, i] - upper, 0.0)
            held = upper + lower
            if held > 0.0 and share > 0.0:
                total += share * (upper * top[j, i] + lower * below[j, i])
                weights += share * held
    return total / weights if weights > 0.0 else np.nan
