"""Inside or outside of a mesh: the parity of surface crossings, voted over three axes.

Rays run along the grid's own lines, so a triangle meets few of them and each crossing is found
once for a whole line of nodes. Parity does not ask which way a triangle is wound; a hole spoils
only the rays through it, and the other two axes outvote those.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.field.grid import Grid
from lmctl.field.kernel import kernel

FloatArray = NDArray[np.float64]

ON_SURFACE_PITCHES = 1e-4


def negate_outside(distance: NDArray[np.float32], corners_mm: FloatArray, grid: Grid) -> int:
    """Negate, in place, the distance of nodes outside a mesh, by the majority of three rays.

    distance : (nz, ny, nx) float32 [mm], unsigned
    corners_mm : (m, 3, 3) float64, triangle, corner, x y z
    returns : the number of nodes the three rays do not agree about: 0 for a closed mesh. Nodes
        on the surface do not count
    """
    relative = np.ascontiguousarray((corners_mm - np.asarray(grid.origin_mm)) / grid.pitch_mm)
    crossings = np.zeros(grid.shape, dtype=np.uint8)
    _crossings_kernel(relative, crossings)
    return int(_vote_kernel(crossings, distance, ON_SURFACE_PITCHES * grid.pitch_mm))


@kernel
def _crossings_kernel(triangles: FloatArray, crossings: NDArray[np.uint8]) -> None:
    """Bit a of a node flips where a ray along axis a (0 = x) entered or left just before it.

    A ray meets a triangle when it lies inside the triangle's shadow by the even-odd rule, half
    open in v and with each edge computed from its lower end: two triangles that share an edge
    get bit for bit the same answer for it, so no ray slips between them or counts both.
    """
    nz, ny, nx = crossings.shape
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
                        crossings[node[2], node[1], node[0]] ^= np.uint8(1 << a)


@kernel
def _vote_kernel(
    crossings: NDArray[np.uint8], distance: NDArray[np.float32], on_surface: float
) -> int:
    """Crossings become parities, in place, and parities a vote; returns the disputed nodes."""
    nz, ny, nx = crossings.shape
    disputed = 0
    for k in range(nz):
        for j in range(ny):
            along_x = np.uint8(0)
            for i in range(nx):
                bits = crossings[k, j, i]
                along_x ^= bits & np.uint8(1)
                bits = (bits & np.uint8(6)) | along_x
                if j > 0:
                    bits ^= crossings[k, j - 1, i] & np.uint8(2)
                if k > 0:
                    bits ^= crossings[k - 1, j, i] & np.uint8(4)
                crossings[k, j, i] = bits
                votes = (bits & 1) + ((bits >> 1) & 1) + ((bits >> 2) & 1)
                if (votes == 1 or votes == 2) and distance[k, j, i] > on_surface:
                    disputed += 1
                if votes < 2:
                    distance[k, j, i] = -distance[k, j, i]
    return disputed
