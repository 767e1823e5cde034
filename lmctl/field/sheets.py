"""Distance of nodes to the surface that oriented patches describe, edges and corners kept sharp.

Around a node the patches fall into at most three sheets (faces that meet there). Each pair of
sheets meets in a ridge or in a groove, told by whether the samples of one lie inside or outside
of the other; that makes the body, locally, an intersection or a union of half-spaces, whose
nearest boundary point is on a sheet, on an edge where two meet, or in the corner of three.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lmctl.field.grid import Grid
from lmctl.field.patches import Patches
from lmctl.field.samples import Samples

FloatArray = NDArray[np.float64]
Sources = NDArray[np.int32]

BAND_PITCHES = 1.25  # nodes this near the fitted surface are seeds


def seed_sheets(
    sources: Sources, samples: Samples, patches: Patches, inward: NDArray[np.int8], grid: Grid
) -> tuple[FloatArray, FloatArray]:
    """Turn `sources`, each node's nearest sample, into seeds, in place.

    sources : (nz, ny, nx) int32, row of a sample or −1; on return row of a seed or −1
    inward : (n,) int8, as in `Orientation`
    returns : surface_mm (m, 3) float64, the closest point of each seed; inner (m, 3) float64,
        the direction inwards there: on an edge or in a corner the mean of the sheets that meet
        (a pseudonormal), so that (p − c) · inner has the sign of p for any p nearest to c
    """
    h = grid.pitch_mm
    origin = np.asarray(grid.origin_mm)
    base = np.ascontiguousarray((patches.base_mm - origin) / h)
    frame = np.stack([patches.normal * inward[:, None], patches.tangent], axis=1)
    bend = patches.bend * h * inward[:, None]
    spacing = samples.spacing_mm / h
    usable = patches.trusted & (inward != 0)
    sheet, ridge = _sheets_kernel(
        base, frame, bend, samples.neighbours, usable, spacing, patches.tolerance_mm / h
    )
    most = int((sources >= 0).sum())
    surface, inner = np.empty((most, 3)), np.empty((most, 3))
    count = _seed_kernel(
        sources, base, frame, bend, samples.neighbours, spacing, sheet, ridge, surface, inner
    )
    return surface[:count] * h + origin, inner[:count]


@njit(cache=True)
def _height(
    base: FloatArray, frame: FloatArray, bend: FloatArray, reach: float, n: int,
    x: float, y: float, z: float,
) -> tuple[float, float, float, float]:
    """Signed distance of a point from patch n, positive on its inner side; its gradient."""
    dx, dy, dz = x - base[n, 0], y - base[n, 1], z - base[n, 2]
    nx, ny, nz = frame[n, 0, 0], frame[n, 0, 1], frame[n, 0, 2]
    along = dx * nx + dy * ny + dz * nz
    if bend[n, 0] == 0.0 and bend[n, 1] == 0.0 and bend[n, 2] == 0.0:
        return along, nx, ny, nz
    tx, ty, tz = frame[n, 1, 0], frame[n, 1, 1], frame[n, 1, 2]
    wx, wy, wz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    u, v = dx * tx + dy * ty + dz * tz, dx * wx + dy * wy + dz * wz
    # Beyond its reach the patch goes on straight: a quadric far out is a guess.
    far = np.sqrt(u * u + v * v)
    beyond = 0.0
    if far > reach:
        u, v, beyond = u * reach / far, v * reach / far, far / reach - 1.0
    fu = 2.0 * bend[n, 0] * u + bend[n, 1] * v
    fv = bend[n, 1] * u + 2.0 * bend[n, 2] * v
    f = (fu * u + fv * v) * (0.5 + beyond)
    size = np.sqrt(1.0 + fu * fu + fv * fv)
    return (
        (along - f) / size,
        (nx - fu * tx - fv * wx) / size,
        (ny - fu * ty - fv * wy) / size,
        (nz - fu * tz - fv * wz) / size,
    )


@njit(cache=True)
def _sheets_kernel(
    base: FloatArray, frame: FloatArray, bend: FloatArray, neighbours: NDArray[np.int32],
    usable: NDArray[np.bool_], spacing: FloatArray, tolerance: float,
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """Sort every sample's neighbourhood (itself first) into sheets, and tell how those meet.

    returns : sheet (n, 17) int8, 0 to 2 or −1 for none; ridge (n, 3) int8, for the pairs AB, BC,
        CA 1 where they meet in a ridge, −1 in a groove, 0 where there is no such pair
    """
    many = neighbours.shape[1] + 1
    sheet = np.full((len(base), many), np.int8(-1), dtype=np.int8)
    ridge = np.zeros((len(base), 3), dtype=np.int8)
    lead = np.zeros(3, dtype=np.int64)
    open_ = np.zeros(many, dtype=np.bool_)
    for n in range(len(base)):
        reach = 2.0 * spacing[n]
        for m in range(many):
            open_[m] = usable[n if m == 0 else neighbours[n, m - 1]]
        sheets = 0
        for first in range(many):
            if not open_[first] or sheets == 3:
                continue
            r0 = n if first == 0 else neighbours[n, first - 1]
            members = 0
            for m in range(first, many):
                r = n if m == 0 else neighbours[n, m - 1]
                if not open_[m]:
                    continue
                same, gap = 0.0, 0.0
                for c in range(3):
                    same += frame[r, 0, c] * frame[r0, 0, c]
                    gap += (base[r, c] - base[r0, c]) ** 2
                off = _height(base, frame, bend, reach, r0, base[r, 0], base[r, 1], base[r, 2])[0]
                if same > 0.5 and abs(off) < tolerance + 0.1 * np.sqrt(gap):
                    open_[m] = False
                    sheet[n, m] = sheets
                    members += 1
            # Which way it meets the sheets before it. Two samples may be strays, and a sheet
            # that meets another neither way is not part of the body here.
            told = sheets == 0 or members >= 3
            for s in range(sheets):
                one, two = 0.0, 0.0
                for m in range(many):
                    r = n if m == 0 else neighbours[n, m - 1]
                    x, y, z = base[r, 0], base[r, 1], base[r, 2]
                    if sheet[n, m] == sheets:
                        one += _height(base, frame, bend, reach, lead[s], x, y, z)[0]
                    elif sheet[n, m] == s:
                        two += _height(base, frame, bend, reach, r0, x, y, z)[0]
                pair = 0 if sheets == 1 else (2 if s == 0 else 1)
                if one > 0.0 and two > 0.0:
                    ridge[n, pair] = 1
                elif one < 0.0 and two < 0.0:
                    ridge[n, pair] = -1
                else:
                    told = False
            if told:
                lead[sheets] = r0
                sheets += 1
            else:
                for m in range(many):
                    if sheet[n, m] == sheets:
                        sheet[n, m] = -1
                for pair in range(1 if sheets == 2 else 0, 3):
                    ridge[n, pair] = 0
    return sheet, ridge


@njit(cache=True)
def _solid(a: bool, b: bool, c: bool, ridge: NDArray[np.int8], sheets: int) -> bool:
    """Is a point inside, by which sheets it is inside of? ridge: AB, BC, CA: 1 ridge, −1 groove.

    The two sheets whose meeting differs from the other two are joined first.
    """
    if sheets == 1:
        return a
    if sheets == 2:
        return (a and b) if ridge[0] > 0 else (a or b)
    if ridge[0] == ridge[1] and ridge[1] == ridge[2]:
        return (a and b and c) if ridge[0] > 0 else (a or b or c)
    if ridge[1] == ridge[2]:
        a, b, c, odd = a, b, c, ridge[0]
    elif ridge[0] == ridge[2]:
        a, b, c, odd = b, c, a, ridge[1]
    else:
        a, b, c, odd = a, c, b, ridge[2]
    return ((a and b) or c) if odd > 0 else ((a or b) and c)


@njit(cache=True)
def _nearest_boundary(
    d: FloatArray, n: FloatArray, ridge: NDArray[np.int8], sheets: int, step: FloatArray,
    inner: FloatArray, solid: NDArray[np.bool_],
) -> float:
    """Signed distance to the boundary of the local body.

    d (3,) : signed distances to the sheets; n (3, 3) : their inward normals; ridge (3,)
    step (3,) : set to the way to the boundary; inner (3,) : to the pseudonormal there
    solid (8,) : scratch
    """
    best = np.inf
    for m in range(8):
        solid[m] = _solid(m & 1 != 0, m & 2 != 0, m & 4 != 0, ridge, sheets)
    mask = 0
    for a in range(sheets):
        if d[a] > 0.0:
            mask |= 1 << a
    inside = solid[mask]
    # Sheets: the foot is on the boundary if crossing the sheet there changes in to out.
    for a in range(sheets):
        mask = 0
        for b in range(sheets):
            if b != a:
                turn = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
                if d[b] - turn * d[a] > 0.0:
                    mask |= 1 << b
        if solid[mask] != solid[mask | (1 << a)] and abs(d[a]) < best:
            best = abs(d[a])
            for c in range(3):
                step[c], inner[c] = -d[a] * n[a, c], n[a, c]
    # Edges: on the boundary if the four quarters around them are not all alike.
    for e in range(sheets if sheets == 3 else sheets - 1):
        a, b, c = e, (e + 1) % 3, (e + 2) % 3
        turn = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
        square = 1.0 - turn * turn
        if square < 0.03:
            continue
        s, t = (d[a] - turn * d[b]) / square, (d[b] - turn * d[a]) / square
        x, y, z = -s * n[a, 0] - t * n[b, 0], -s * n[a, 1] - t * n[b, 1], -s * n[a, 2] - t * n[b, 2]
        mask = 0
        if sheets == 3 and d[c] + x * n[c, 0] + y * n[c, 1] + z * n[c, 2] > 0.0:
            mask = 1 << c
        quarters = (
            int(solid[mask]) + int(solid[mask | (1 << a)]) + int(solid[mask | (1 << b)])
            + int(solid[mask | (1 << a) | (1 << b)])
        )
        length = np.sqrt(x * x + y * y + z * z)
        if 0 < quarters < 4 and length < best:
            best = length
            step[0], step[1], step[2] = x, y, z
            for c in range(3):
                inner[c] = n[a, c] + n[b, c]
    if sheets == 3:
        x, y, z = 0.0, 0.0, 0.0
        det = 0.0
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            cx = n[b, 1] * n[c, 2] - n[b, 2] * n[c, 1]
            cy = n[b, 2] * n[c, 0] - n[b, 0] * n[c, 2]
            cz = n[b, 0] * n[c, 1] - n[b, 1] * n[c, 0]
            det = n[a, 0] * cx + n[a, 1] * cy + n[a, 2] * cz
            x, y, z = x - d[a] * cx, y - d[a] * cy, z - d[a] * cz
        length = np.sqrt(x * x + y * y + z * z) / max(abs(det), 1e-12)
        if abs(det) > 0.1 and length < best:
            best = length
            step[0], step[1], step[2] = x / det, y / det, z / det
            for c in range(3):
                inner[c] = n[0, c] + n[1, c] + n[2, c]
    return best if inside else -best


@njit(cache=True)
def _seed_kernel(
    sources: Sources, base: FloatArray, frame: FloatArray, bend: FloatArray,
    neighbours: NDArray[np.int32], spacing: FloatArray, sheet: NDArray[np.int8],
    ridge: NDArray[np.int8], surface: FloatArray, inner: FloatArray,
) -> int:
    """Everything in node units. Returns the number of seeds."""
    nz, ny, nx = sources.shape
    many = neighbours.shape[1] + 1
    total, d, n = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    heights, slopes = np.empty(many), np.empty((many, 3))
    step, way, solid = np.zeros(3), np.zeros(3), np.zeros(8, dtype=np.bool_)
    count = 0
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                nearest = sources[k, j, i]
                if nearest < 0:
                    continue
                sources[k, j, i] = -1
                x, y, z = float(i), float(j), float(k)
                reach, sheets, least = 2.0 * spacing[nearest], 0, np.inf
                for m in range(many):
                    s = sheet[nearest, m]
                    if s >= 0:
                        r = nearest if m == 0 else neighbours[nearest, m - 1]
                        heights[m], slopes[m, 0], slopes[m, 1], slopes[m, 2] = _height(
                            base, frame, bend, reach, r, x, y, z
                        )
                        least = min(least, abs(heights[m]))
                        sheets = max(sheets, s + 1)
                if least > 1.5 * BAND_PITCHES:
                    continue
                # Each sheet is the mean of its patches, the ones near the node counting most.
                first = (
                    (x - base[nearest, 0]) ** 2 + (y - base[nearest, 1]) ** 2
                    + (z - base[nearest, 2]) ** 2
                )
                for s in range(3):
                    total[s], d[s], n[s, 0], n[s, 1], n[s, 2] = 0.0, 0.0, 0.0, 0.0, 0.0
                for m in range(many):
                    s = sheet[nearest, m]
                    if s >= 0:
                        r = nearest if m == 0 else neighbours[nearest, m - 1]
                        away = (x - base[r, 0]) ** 2 + (y - base[r, 1]) ** 2 + (z - base[r, 2]) ** 2
                        weight = np.exp(min(0.0, first - away) / spacing[nearest] ** 2) + 1e-9
                        total[s] += weight
                        d[s] += weight * heights[m]
                        for c in range(3):
                            n[s, c] += weight * slopes[m, c]
                for s in range(sheets):
                    d[s] /= total[s]
                    size = np.sqrt(n[s, 0] ** 2 + n[s, 1] ** 2 + n[s, 2] ** 2)
                    for c in range(3):
                        n[s, c] /= size
                distance = _nearest_boundary(d, n, ridge[nearest], sheets, step, way, solid)
                if abs(distance) > BAND_PITCHES:
                    continue
                for c in range(3):
                    surface[count, c] = (x, y, z)[c] + step[c]
                    inner[count, c] = way[c]
                if _supported(surface, count, base, neighbours, nearest, spacing[nearest]):
                    sources[k, j, i] = count
                    count += 1
    return count


@njit(cache=True)
def _supported(
    surface: FloatArray, count: int, base: FloatArray, neighbours: NDArray[np.int32], nearest: int,
    spacing: float,
) -> bool:
    """Whether samples lie around a surface point, or at least one is quite near.

    Within a gap samples lie on all sides. Beyond the last samples of a sheet they all lie on
    one: there the patch only extrapolates, and may already be in the air.
    """
    x, y, z, least, found = 0.0, 0.0, 0.0, np.inf, 0
    for m in range(neighbours.shape[1] + 1):
        r = nearest if m == 0 else neighbours[nearest, m - 1]
        dx, dy = base[r, 0] - surface[count, 0], base[r, 1] - surface[count, 1]
        dz = base[r, 2] - surface[count, 2]
        away = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
        least = min(least, away)
        if away < 2.5 * spacing:
            x, y, z, found = x + dx / away, y + dy / away, z + dz / away, found + 1
    if least < 0.7 * spacing:
        return True
    return found > 0 and np.sqrt(x * x + y * y + z * z) < 0.6 * found
