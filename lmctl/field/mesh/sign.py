"""Decide inside or outside of a mesh by a vote of surface crossings along three axes.

Rays run along the grid's own lines, so a triangle meets few of them and each crossing is found
once for a whole line of nodes. A crossing counts +1 or −1 by the way its triangle faces: the sum on
the way to a node is the ray's own winding number, and whether it is odd is parity.

- Where triangles face consistently (all one way or the other) a node is inside where the sum is not
  0: so solids that overlap are one. Where they do not, parity decides, whatever the facing.
- A ray that does not end outside again has passed through a hole: it abstains.
- Where the rays that are left disagree, the side is that of the undisputed nodes from which the
  widest way leads there (`flood`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.field.priority_flood import LEVEL_COUNT, flood_tags

Sums = NDArray[np.int16]

ON_SURFACE_PITCHES = 1e-4
LEVELS_PER_PITCH = 8
# Share of rays that end neither outside nor odd; random facing makes it half of them.
MAX_TURNED_RAY_FRACTION = 0.05


def negate_outside(
    distance: NDArray[np.float32], corners_mm: FloatArray, grid: Grid
) -> tuple[int, int]:
    """Negate, in place, the distance of nodes outside a mesh, by the vote of three rays.

    distance : (nz, ny, nx) float32 [mm], unsigned
    corners_mm : (m, 3, 3) float64, triangle, corner, x y z; no triangle twice
    returns : the number of rays that do not come out again, where the grid holds the mesh, and of
        nodes the others do not agree about: both 0 for a closed mesh. Nodes on the surface do not
        count
    """
    relative = np.ascontiguousarray((corners_mm - np.asarray(grid.origin_mm)) / grid.pitch_mm)
    sums = np.zeros(grid.shape, dtype=np.int16)
    _crossings_kernel(relative, sums)
    rays, turned = _running_kernel(sums)
    last = np.asarray(grid.shape[::-1]) - 1
    held = bool(np.all((relative > 0.0) & (relative < last)))
    facing = held and turned <= MAX_TURNED_RAY_FRACTION * rays
    on_surface = ON_SURFACE_PITCHES * grid.pitch_mm
    lost = int(_lost_kernel(sums, facing)) if held else 0
    disputed = int(_vote_kernel(sums, distance, on_surface, held, facing))
    sides = sums.astype(np.int8)
    del sums
    if disputed:
        level = np.minimum(distance * (LEVELS_PER_PITCH / grid.pitch_mm), LEVEL_COUNT - 1)
        flood_tags(level.astype(np.uint8), sides)
    np.negative(distance, out=distance, where=sides <= 0)
    return lost, disputed


@kernel
def _crossings_kernel(triangles: FloatArray, sums: Sums) -> None:
    """Count crossings: digit a (0 = x) of a node's number in base 32 is the sum of the crossings
    just before it on a ray along axis a, each digit from −16 to 15.

    A ray meets a triangle when it lies inside the triangle's shadow by the even-odd rule, half
    open in v and with each edge computed from its lower end: two triangles that share an edge
    get bit for bit the same answer for it, so no ray slips between them or counts both.
    """
    nz, ny, nx = sums.shape
    count = np.array([nx, ny, nz])
    node = np.empty(3, dtype=np.int64)
    for n in range(triangles.shape[0]):
        t = triangles[n]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            c0 = max(0, int(np.ceil(min(t[0, c], t[1, c], t[2, c]))))
            c1 = min(count[c] - 1, int(np.floor(max(t[0, c], t[1, c], t[2, c]))))
            area = (t[1, b] - t[0, b]) * (t[2, c] - t[0, c]) - (t[1, c] - t[0, c]) * (
                t[2, b] - t[0, b]
            )
            if area == 0.0:
                continue
            vote = np.int16(1 << (5 * a)) if area < 0.0 else np.int16(-(1 << (5 * a)))
            da, ea = t[1, a] - t[0, a], t[2, a] - t[0, a]
            # Height of the triangle's plane over its shadow: a = a0 + gb (b - b0) + gc (c - c0).
            gb = (da * (t[2, c] - t[0, c]) - ea * (t[1, c] - t[0, c])) / area
            gc = (ea * (t[1, b] - t[0, b]) - da * (t[2, b] - t[0, b])) / area
            lowest = min(t[0, a], t[1, a], t[2, a])
            highest = max(t[0, a], t[1, a], t[2, a])
            for v in range(c0, c1 + 1):
                # The row crosses the shadow between exactly two of its edges, or none.
                enter, leave, met = np.inf, -np.inf, 0
                for e in range(3):
                    p, q = e, (e + 1) % 3
                    if t[p, c] > t[q, c]:
                        p, q = q, p
                    if (t[p, c] > v) != (t[q, c] > v):
                        at = t[p, b] + (v - t[p, c]) * ((t[q, b] - t[p, b]) / (t[q, c] - t[p, c]))
                        enter, leave, met = min(enter, at), max(leave, at), met + 1
                if met != 2:
                    continue
                u0 = max(0, int(np.floor(enter)) + 1)
                u1 = min(count[b] - 1, int(np.floor(leave)))
                for u in range(u0, u1 + 1):
                    height = t[0, a] + gb * (u - t[0, b]) + gc * (v - t[0, c])
                    height = min(max(height, lowest), highest)
                    first = max(0, int(np.floor(height)) + 1)
                    if first < count[a]:
                        node[a], node[b], node[c] = first, u, v
                        sums[node[2], node[1], node[0]] += vote


@inner_kernel
def _digits(number: int) -> tuple[int, int, int]:
    x = ((number + 16) & 31) - 16
    rest = (number - x) >> 5
    y = ((rest + 16) & 31) - 16
    return x, y, (rest - y) >> 5


@kernel
def _running_kernel(sums: Sums) -> tuple[int, int]:
    """Crossings become sums along each axis, in place.

    returns : the number of rays along x that cross the mesh; and of those whose crossings are even
        in number but do not cancel
    """
    nz, ny, nx = sums.shape
    rays, turned = 0, 0
    for k in range(nz):
        for j in range(ny):
            along, crossed = 0, False
            for i in range(nx):
                own = int(np.int64(sums[k, j, i]))
                across, up = 0, 0
                if j > 0:
                    across = _digits(int(np.int64(sums[k, j - 1, i])))[1]
                if k > 0:
                    up = _digits(int(np.int64(sums[k - 1, j, i])))[2]
                if own != 0:
                    x, y, z = _digits(own)
                    crossed = crossed or x != 0
                    along, across, up = along + x, across + y, up + z
                sums[k, j, i] = np.int16(along + 32 * across + 1024 * up)
            rays += crossed
            turned += along != 0 and along & 1 == 0
    return rays, turned


@kernel
def _lost_kernel(sums: Sums, facing: bool) -> int:
    """How many rays do not end outside."""
    nz, ny, nx = sums.shape
    lost = 0
    for k in range(nz):
        for j in range(ny):
            lost += _outside_is_not(_digits(int(np.int64(sums[k, j, nx - 1])))[0], facing)
        for i in range(nx):
            lost += _outside_is_not(_digits(int(np.int64(sums[k, ny - 1, i])))[1], facing)
    for j in range(ny):
        for i in range(nx):
            lost += _outside_is_not(_digits(int(np.int64(sums[nz - 1, j, i])))[2], facing)
    return lost


@kernel
def _vote_kernel(
    sums: Sums, distance: NDArray[np.float32], on_surface: float, held: bool, facing: bool
) -> int:
    """Sums become sides, in place: 1 inside, −1 outside, 0 in dispute. Returns how many of these.

    held : the grid holds the mesh, so a ray that does not end outside is not valid
    """
    nz, ny, nx = sums.shape
    disputed = 0
    for k in range(nz):
        for j in range(ny):
            end = int(np.int64(sums[k, j, nx - 1]))
            broken_x = held and _outside_is_not(_digits(end)[0], facing)
            for i in range(nx):
                x, y, z = _digits(int(np.int64(sums[k, j, i])))
                votes, cast = 0, 0
                if not broken_x:
                    votes, cast = 1 if _outside_is_not(x, facing) else -1, 1
                end = int(np.int64(sums[k, ny - 1, i]))
                if end == 0 or not held or not _outside_is_not(_digits(end)[1], facing):
                    votes, cast = votes + (1 if _outside_is_not(y, facing) else -1), cast + 1
                end = int(np.int64(sums[nz - 1, j, i]))
                if end == 0 or not held or not _outside_is_not(_digits(end)[2], facing):
                    votes, cast = votes + (1 if _outside_is_not(z, facing) else -1), cast + 1
                side = 1 if votes > 0 else -1
                if (cast == 0 or abs(votes) < cast) and distance[k, j, i] > on_surface:
                    disputed += 1
                    side = 0
                sums[k, j, i] = side
    return disputed


@inner_kernel
def _outside_is_not(total: int, facing: bool) -> bool:
    """Whether a ray with this sum is inside."""
    return total != 0 if facing else total & 1 == 1
