"""Distance of the nodes near a cloud to the surface its sheets describe.

The nearest boundary point of a local intersection or union of half-spaces is on a sheet, on an
edge where two sheets meet, or in the corner of three: all are tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.cloud.local_faces import MAX_FACE_MEMBERS, LocalFaces, height_over_patch
from lmctl.field.cloud.samples import CloudSamples
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel

Sources = NDArray[np.int32]

BAND_PITCHES = 1.25  # nodes this near the fitted surface are seeds
ABOVE = 0.35  # sine of the angle to a sheet from which on a point is above it, not beside it
FAR_PITCHES = 1.5  # a node this far from the nearest sample's patch is no seed


@dataclass(frozen=True)
class CloudSeeds:
    """Nodes near a cloud's surface.

    nodes : (m,) int64, flat index of each in the grid, rising
    surface_mm : (m, 3) float64, the closest point of each
    inwards : (m, 3) float64, the direction inwards from there through the node
    distance_mm : (m,) float64, positive inside
    is_supported : (m,) bool, whether samples are near the closest point, or on all sides of it
    """

    nodes: NDArray[np.int64]
    surface_mm: FloatArray
    inwards: FloatArray
    distance_mm: FloatArray
    is_supported: NDArray[np.bool_]


def seed_cloud(owner: Sources, samples: CloudSamples, sheets: LocalFaces, grid: Grid) -> CloudSeeds:
    """The nodes near a cloud's surface, each with its closest point.

    owner : (nz, ny, nx) int32, row of the nearest sample, or −1 where none is near
    """
    most = int((owner >= 0).sum())
    nodes, distance = np.empty(most, dtype=np.int64), np.empty(most)
    surface, inwards = np.empty((most, 3)), np.empty((most, 3))
    supported = np.empty(most, dtype=np.bool_)
    count = _seed_kernel(
        owner, sheets.patch, sheets.spacing, sheets.face_count, sheets.face_members,
        sheets.solid_bits,
        samples.neighbours, nodes, surface, inwards, distance, supported,
    )
    return CloudSeeds(
        nodes[:count].copy(), surface[:count] * grid.pitch_mm + np.asarray(grid.origin_mm),
        inwards[:count].copy(), distance[:count] * grid.pitch_mm, supported[:count].copy(),
    )


@kernel
def _seed_kernel(
    owner: Sources, patch: FloatArray, spacing: FloatArray,
    sheet_count: NDArray[np.uint8], member: NDArray[np.int32], solid: NDArray[np.uint8],
    neighbours: NDArray[np.int32], nodes: NDArray[np.int64], surface: FloatArray,
    inwards: FloatArray, distance: FloatArray, supported: NDArray[np.bool_],
) -> int:
    """Everything in node units. Returns the number of seeds."""
    nz, ny, nx = owner.shape
    d, n, step = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    count = 0
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                nearest = int(np.int64(owner[k, j, i]))
                if nearest < 0 or sheet_count[nearest] == 0:
                    continue
                x, y, z = float(i), float(j), float(k)
                reach, sheets = 2.0 * spacing[nearest], int(np.int64(sheet_count[nearest]))
                off = False
                # Each sheet is the mean of its patches, the ones near the node counting most.
                sharpness = 2.0 / spacing[nearest] ** 2
                n[1, 0] = n[1, 1] = n[1, 2] = n[2, 0] = n[2, 1] = n[2, 2] = 0.0
                for s in range(sheets):
                    total, height, sx, sy, sz, first = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                    for m in range(MAX_FACE_MEMBERS):
                        r = int(np.int64(member[nearest, s, m]))
                        if r < 0:
                            break
                        away = (x - patch[r, 0]) ** 2 + (y - patch[r, 1]) ** 2 + (
                            z - patch[r, 2]
                        ) ** 2
                        if m == 0:
                            first = away
                        weight = 1.0 / (1.0 + sharpness * max(away - first, 0.0)) ** 2
                        here, gx, gy, gz = height_over_patch(patch, r, reach, x, y, z)
                        if sheets == 1 and abs(here) > FAR_PITCHES:
                            # One sheet only, and its nearest patch shows that the node is off it.
                            off = True
                            break
                        total += weight
                        height += weight * here
                        sx, sy, sz = sx + weight * gx, sy + weight * gy, sz + weight * gz
                    if off:
                        break
                    size = np.sqrt(sx * sx + sy * sy + sz * sz)
                    d[s] = height / total
                    n[s, 0], n[s, 1], n[s, 2] = sx / size, sy / size, sz / size
                if off:
                    continue
                near = _nearest_boundary(d, n, int(np.int64(solid[nearest])), sheets, step)
                if abs(near) > BAND_PITCHES:
                    continue
                surface[count, 0] = x + step[0]
                surface[count, 1] = y + step[1]
                surface[count, 2] = z + step[2]
                distance[count] = near
                supported[count] = _supported(
                    x + step[0], y + step[1], z + step[2], patch, neighbours, nearest,
                    spacing[nearest],
                )
                # On the surface itself, all sheets there define the inward direction.
                for c in range(3):
                    inwards[count, c] = -step[c] / near
                    if abs(near) < 0.1:
                        inwards[count, c] = (n[0, c] + n[1, c] + n[2, c]) / sheets
                nodes[count] = (k * ny + j) * nx + i
                count += 1
    return count


@inner_kernel
def _nearest_boundary(
    d: FloatArray, n: FloatArray, solid: int, sheets: int, step: FloatArray
) -> float:
    """Signed distance to the boundary of the local body.

    d (3,) : signed distances to the sheets; n (3, 3) : their inward normals
    step (3,) : set to the way to the boundary
    """
    best = np.inf
    mask = 0
    for a in range(sheets):
        if d[a] > 0.0:
            mask |= 1 << a
    inside = (solid >> mask) & 1
    # Sheets: the closest point is on the boundary if crossing the sheet there changes in to out.
    for a in range(sheets):
        mask = 0
        for b in range(sheets):
            if b != a:
                turn = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
                if d[b] - turn * d[a] > 0.0:
                    mask |= 1 << b
        if (solid >> mask) & 1 != (solid >> (mask | 1 << a)) & 1 and abs(d[a]) < best:
            best = abs(d[a])
            for c in range(3):
                step[c] = -d[a] * n[a, c]
    # Edges: on the boundary if the four quarters around them are not all alike.
    for e in range(sheets if sheets == 3 else sheets - 1):
        a, b, c = e, (e + 1) % 3, (e + 2) % 3
        turn = n[a, 0] * n[b, 0] + n[a, 1] * n[b, 1] + n[a, 2] * n[b, 2]
        square = 1.0 - turn * turn
        if square < 0.03:
            continue
        s, t = (d[a] - turn * d[b]) / square, (d[b] - turn * d[a]) / square
        x, y = -s * n[a, 0] - t * n[b, 0], -s * n[a, 1] - t * n[b, 1]
        z = -s * n[a, 2] - t * n[b, 2]
        mask = 0
        if sheets == 3 and d[c] + x * n[c, 0] + y * n[c, 1] + z * n[c, 2] > 0.0:
            mask = 1 << c
        quarters = (
            ((solid >> mask) & 1) + ((solid >> (mask | 1 << a)) & 1)
            + ((solid >> (mask | 1 << b)) & 1) + ((solid >> (mask | 1 << a | 1 << b)) & 1)
        )
        length = np.sqrt(x * x + y * y + z * z)
        if 0 < quarters < 4 and length < best:
            best = length
            step[0], step[1], step[2] = x, y, z
    if sheets == 3:
        x, y, z, det = 0.0, 0.0, 0.0, 0.0
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
    return float(best if inside else -best)


@inner_kernel
def _supported(
    x: float, y: float, z: float, patch: FloatArray, neighbours: NDArray[np.int32], nearest: int,
    spacing: float,
) -> bool:
    """Whether samples lie around a surface point, or at least one is quite near.

    Within a gap samples lie on all sides. Beyond the last samples of a sheet they all lie on
    one side: there the patch is only extrapolated straight and may already be in the air. Samples
    directly above or below the point belong to another sheet and do not count.
    """
    sx, sy, sz, found = 0.0, 0.0, 0.0, 0
    for m in range(neighbours.shape[1] + 1):
        r = nearest if m == 0 else int(np.int64(neighbours[nearest, m - 1]))
        dx, dy, dz = patch[r, 0] - x, patch[r, 1] - y, patch[r, 2] - z
        away = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
        if away < 0.7 * spacing:
            return True
        off = dx * patch[r, 3] + dy * patch[r, 4] + dz * patch[r, 5]
        if away < 2.5 * spacing and abs(off) < ABOVE * away:
            sx, sy, sz, found = sx + dx / away, sy + dy / away, sz + dz / away, found + 1
    return found > 0 and bool(sx * sx + sy * sy + sz * sz < (0.55 * found) ** 2)
