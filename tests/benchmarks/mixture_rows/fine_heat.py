"""Temperature while a job is deposited, by finite differences at a quarter of a bead.

An oracle for the planner's own prediction: it reads nothing but the job's lines, shares no code
with lmctl.plan, and resolves what the planner does not: the bead's cross-section (a strip, born
cell by cell where the beam passes), the beam (power even over a disc as wide as the bead) and half
a layer in height. Constants of materials are the same, and do not change with temperature.

Cells are even where the part is and grow in the plate, away from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

BEAD = 3  # LineKind


@dataclass(frozen=True)
class FineConstants:
    """Of m materials, (m,) each, and of plate and surroundings; W, mm, K, J, s."""

    conductivity: np.ndarray
    capacity: np.ndarray
    absorptivity: np.ndarray
    plate_conductivity: float
    plate_capacity: float
    plate_mm: float
    plate_C: float
    contact: float
    loss: float
    ambient_C: float


@dataclass(frozen=True)
class FineBeads:
    """Beads of a job in order, n lines: (n, 3) start and end, times, power, strip, mixture."""

    start_mm: np.ndarray
    end_mm: np.ndarray
    start_s: np.ndarray
    end_s: np.ndarray
    power_W: np.ndarray
    strip_mm: np.ndarray
    fractions: np.ndarray
    layer: np.ndarray


def beads_of(layers, overlap: float) -> FineBeads:
    """The bead lines of a job's layers (`JobLayer`)."""
    parts = []
    for number, layer in enumerate(layers):
        lines = layer.lines
        place = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]])
        bead = np.flatnonzero(lines["kind"] == BEAD)
        parts.append((
            place[bead - 1], place[bead], lines["end_s"][bead - 1], lines["end_s"][bead],
            lines["power_W"][bead].astype(float),
            lines["bead_width_mm"][bead].astype(float) * (1 - overlap),
            lines["fractions"][bead].astype(float), np.full(len(bead), number)))
    return FineBeads(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def fine_temperatures(
    beads: FineBeads, constants: FineConstants, layer_mm: float, bead_mm: float,
    read_s: np.ndarray, read_mm: np.ndarray, cell_mm: float = 0.5,
) -> np.ndarray:
    """Temperature of the topmost cell at places (r, 2) at times (r,), rising [°C]."""
    low, high = beads.end_mm[:, :2].min(axis=0), beads.end_mm[:, :2].max(axis=0)
    edges = [_grown(lo - bead_mm, hi + bead_mm, cell_mm) for lo, hi in zip(low, high, strict=True)]
    plate_z = _downward(constants.plate_mm, layer_mm / 2)
    n_layers = int(beads.layer.max()) + 1
    z = np.concatenate([plate_z, np.full(2 * n_layers, layer_mm / 2)])
    mixed = [beads.fractions @ column for column in
             (constants.conductivity, constants.capacity, constants.absorptivity)]
    order = np.argsort(read_s, kind="stable")
    most = max((constants.conductivity / constants.capacity).max(),
               constants.plate_conductivity / constants.plate_capacity)
    step_s = 0.9 / (2 * most * (2 / cell_mm**2 + 4 / layer_mm**2))
    found = np.empty(len(read_s))
    found[order] = _solve(
        edges[0], edges[1], z, len(plate_z), constants.plate_conductivity,
        constants.plate_capacity, constants.plate_C, constants.contact, constants.loss,
        constants.ambient_C, beads.start_mm, beads.end_mm, beads.start_s, beads.end_s,
        beads.power_W * mixed[2], beads.strip_mm, mixed[0], mixed[1],
        beads.layer, bead_mm, step_s, read_s[order], read_mm[order])
    return found


def _grown(low: float, high: float, cell: float, beyond: float = 70.0) -> np.ndarray:
    """Edges of even cells from low to high, and growing ones beyond."""
    count = int(np.ceil((high - low) / cell))
    inner = low + cell * np.arange(count + 1)
    step, outer = cell, [0.0]
    while outer[-1] < beyond:
        step *= 1.4
        outer.append(outer[-1] + step)
    grown = np.array(outer[1:])
    return np.concatenate([inner[0] - grown[::-1], inner, inner[-1] + grown])


def _downward(thick: float, first: float) -> np.ndarray:
    """Heights of cells from the plate's lower side up to its top, where they are thinnest."""
    heights, step = [], first
    while sum(heights) + step * 1.3 < thick:
        heights.append(step)
        step *= 1.3
    heights.append(thick - sum(heights))
    return np.array(heights[::-1])


@njit(cache=True)
def _solve(ex, ey, dz, n_plate, k_plate, c_plate, plate_C, contact, loss, ambient, start, end,
           start_s, end_s, watts, strip, k_line, c_line, layer, bead_mm, step_s, read_s, read_mm):
    nx, ny, nz = len(ex) - 1, len(ey) - 1, len(dz)
    dx, dy = np.diff(ex), np.diff(ey)
    mx, my = (ex[1:] + ex[:-1]) / 2, (ey[1:] + ey[:-1]) / 2
    t = np.full((nz, ny, nx), plate_C)
    rate = np.zeros((nz, ny, nx))
    k = np.zeros((nz, ny, nx))
    c = np.ones((nz, ny, nx))
    top = np.full((ny, nx), n_plate - 1)
    k[:n_plate] = k_plate
    c[:n_plate] = c_plate
    result = np.empty(len(read_s))
    line, read, clock = 0, 0, 0.0
    ceiling = n_plate
    while read < len(read_s):
        # read what is due
        while read < len(read_s) and read_s[read] <= clock + 0.5 * step_s:
            i = min(max(np.searchsorted(ex, read_mm[read, 0]) - 1, 0), nx - 1)
            j = min(max(np.searchsorted(ey, read_mm[read, 1]) - 1, 0), ny - 1)
            result[read] = t[top[j, i], j, i]
            read += 1
        # beam
        while line < len(start_s) and end_s[line] <= clock:
            line += 1
        rate[:ceiling] = 0.0
        if line < len(start_s) and start_s[line] <= clock:
            u = (clock - start_s[line]) / (end_s[line] - start_s[line])
            x = start[line, 0] + u * (end[line, 0] - start[line, 0])
            y = start[line, 1] + u * (end[line, 1] - start[line, 1])
            low = n_plate + 2 * layer[line]
            ceiling = max(ceiling, low + 2)
            ax, ay = end[line, 0] - start[line, 0], end[line, 1] - start[line, 1]
            size = np.hypot(ax, ay)
            ax, ay = ax / size, ay / size
            reach = max(bead_mm, strip[line]) / 2 + dx[nx // 2]
            a0, a1 = np.searchsorted(ex, x - reach) - 1, np.searchsorted(ex, x + reach)
            b0, b1 = np.searchsorted(ey, y - reach) - 1, np.searchsorted(ey, y + reach)
            for j in range(b0, b1):
                for i in range(a0, a1):
                    px, py = mx[i] - x, my[j] - y
                    along, across = px * ax + py * ay, px * ay - py * ax
                    if abs(across) <= strip[line] / 2 and abs(along) <= dx[i]:
                        for z in (low, low + 1):
                            if k[z, j, i] == 0.0:
                                k[z, j, i], c[z, j, i] = k_line[line], c_line[line]
                                t[z, j, i] = ambient
                                top[j, i] = z
            # power over the disc, where the layer or the one below it is: what the planner calls
            # absorbed stays in the part and does not pass beside a wall
            area = 0.0
            for j in range(b0, b1):
                for i in range(a0, a1):
                    if top[j, i] >= low - 1 and (
                            (mx[i] - x) ** 2 + (my[j] - y) ** 2 <= bead_mm**2 / 4):
                        area += dx[i] * dy[j]
            for j in range(b0, b1):
                for i in range(a0, a1):
                    if top[j, i] >= low - 1 and (
                            (mx[i] - x) ** 2 + (my[j] - y) ** 2 <= bead_mm**2 / 4):
                        rate[top[j, i], j, i] += watts[line] * dx[i] * dy[j] / area
        # conduction
        for z in range(ceiling):
            for j in range(ny):
                for i in range(nx):
                    kk = k[z, j, i]
                    if kk == 0.0:
                        continue
                    own = t[z, j, i]
                    if i + 1 < nx:
                        if k[z, j, i + 1] > 0.0:
                            q = dy[j] * dz[z] * (t[z, j, i + 1] - own) / (
                                0.5 * dx[i] / kk + 0.5 * dx[i + 1] / k[z, j, i + 1])
                            rate[z, j, i] += q
                            rate[z, j, i + 1] -= q
                        else:
                            rate[z, j, i] -= loss * dy[j] * dz[z] * (own - ambient)
                    if i > 0 and k[z, j, i - 1] == 0.0:
                        rate[z, j, i] -= loss * dy[j] * dz[z] * (own - ambient)
                    if j + 1 < ny:
                        if k[z, j + 1, i] > 0.0:
                            q = dx[i] * dz[z] * (t[z, j + 1, i] - own) / (
                                0.5 * dy[j] / kk + 0.5 * dy[j + 1] / k[z, j + 1, i])
                            rate[z, j, i] += q
                            rate[z, j + 1, i] -= q
                        else:
                            rate[z, j, i] -= loss * dx[i] * dz[z] * (own - ambient)
                    if j > 0 and k[z, j - 1, i] == 0.0:
                        rate[z, j, i] -= loss * dx[i] * dz[z] * (own - ambient)
                    if z + 1 < ceiling and k[z + 1, j, i] > 0.0:
                        q = dx[i] * dy[j] * (t[z + 1, j, i] - own) / (
                            0.5 * dz[z] / kk + 0.5 * dz[z + 1] / k[z + 1, j, i])
                        rate[z, j, i] += q
                        rate[z + 1, j, i] -= q
                    else:
                        rate[z, j, i] -= loss * dx[i] * dy[j] * (own - ambient)
                    if z == 0:
                        rate[z, j, i] -= dx[i] * dy[j] * (own - plate_C) / (
                            1 / contact + 0.5 * dz[0] / kk)
        for z in range(ceiling):
            for j in range(ny):
                for i in range(nx):
                    if k[z, j, i] > 0.0:
                        t[z, j, i] += step_s * rate[z, j, i] / (
                            c[z, j, i] * dx[i] * dy[j] * dz[z])
        clock += step_s
    return result
