"""The faces that meet around every sample of a cloud, separated so that edges stay sharp.

The patches around a sample fall into at most three sheets (faces that meet there). Each pair of
sheets meets in a ridge or in a groove: the samples of one lie inside or outside of the other.
Locally, that makes the body an intersection or a union of half-spaces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.cloud.patches import FittedPatches
from lmctl.field.cloud.samples import CloudSamples
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel

# patches that are averaged to a sheet: enough to smooth noise, few enough to be local
MAX_FACE_MEMBERS = 8
MIN_FACE_MEMBERS = 3  # two samples may be strays
SAME_SHEET_SLOPE = 0.1  # a sample this steeply off a patch belongs to another sheet
# cosine of the angle between patches of one sheet; where an edge is near
FLAT_FACE_MIN_COSINE = 0.9
SMOOTH_FACE_MIN_COSINE = 0.5  # where none is, patches of a tight curve may differ more
MAX_LEADS_TRIED = 4


@dataclass(frozen=True)
class LocalFaces:
    """What lies around each sample, in node units of a grid.

    patch : (n, 12) float64, base, inward normal, tangent (x, y, z each) and bend, as in
    `FittedPatches`
    spacing : (n,) float64
    face_count : (n,) uint8, number of sheets, 0 to 3
    face_members : (n, 3, 8) int32, the samples of each sheet, nearest first, −1 where there are no
    more
    solid_bits : (n,) uint8, bit m is set if a point on the inner side of exactly the sheets whose
        bits are set in m is inside
    """

    patch: FloatArray
    spacing: FloatArray
    face_count: NDArray[np.uint8]
    face_members: NDArray[np.int32]
    solid_bits: NDArray[np.uint8]


def group_into_faces(
    samples: CloudSamples, patches: FittedPatches, inward: NDArray[np.int8], grid: Grid
) -> LocalFaces:
    """Sort every sample's neighbourhood into sheets.

    inward : (n,) int8, as in `SampleOrientation`
    """
    h = grid.pitch_mm
    patch = np.hstack([
        (patches.base_mm - np.asarray(grid.origin_mm)) / h,
        patches.normal * inward[:, None],
        patches.tangent,
        # The other tangent turns with the normal, and with it the sign of the mixed term.
        patches.curvature_coefficients * h * np.stack([inward, np.ones_like(inward), inward],
                                                      axis=1),
    ])
    spacing = samples.spacing_mm / h
    usable = patches.is_trusted & (inward != 0)
    member = np.full((len(patch), 3, MAX_FACE_MEMBERS), -1, dtype=np.int32)
    solid, count = np.zeros(len(patch), dtype=np.uint8), np.zeros(len(patch), dtype=np.uint8)
    _sort_kernel(
        patch, samples.neighbours, usable, patches.is_smooth, spacing, patches.tolerance_mm / h,
        count, member, solid,
    )
    return LocalFaces(patch, spacing, count, member, solid)


@inner_kernel
def height_over_patch(
    patch: FloatArray, n: int, reach: float, x: float, y: float, z: float
) -> tuple[float, float, float, float]:
    """Signed distance of a point from patch n, positive on its inner side; its gradient.

    Beyond its reach a patch is extended straight: a quadric far out is a guess.
    """
    dx, dy, dz = x - patch[n, 0], y - patch[n, 1], z - patch[n, 2]
    nx, ny, nz = patch[n, 3], patch[n, 4], patch[n, 5]
    along = dx * nx + dy * ny + dz * nz
    if patch[n, 9] == 0.0 and patch[n, 10] == 0.0 and patch[n, 11] == 0.0:
        return along, nx, ny, nz
    tx, ty, tz = patch[n, 6], patch[n, 7], patch[n, 8]
    wx, wy, wz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    u, v = dx * tx + dy * ty + dz * tz, dx * wx + dy * wy + dz * wz
    far, beyond = np.sqrt(u * u + v * v), 0.0
    if far > reach:
        u, v, beyond = u * reach / far, v * reach / far, far / reach - 1.0
    fu = 2.0 * patch[n, 9] * u + patch[n, 10] * v
    fv = patch[n, 10] * u + 2.0 * patch[n, 11] * v
    size = 1.0 / np.sqrt(1.0 + fu * fu + fv * fv)
    return (
        (along - (fu * u + fv * v) * (0.5 + beyond)) * size,
        (nx - fu * tx - fv * wx) * size,
        (ny - fu * ty - fv * wy) * size,
        (nz - fu * tz - fv * wz) * size,
    )


@inner_kernel
def _solid_bits(meets: NDArray[np.int64]) -> int:
    """`LocalFaces.solid` from how the pairs AB, BC, CA of sheets meet, 1 in a ridge, −1 in a
    groove, and the number of sheets.

    The two of three sheets whose meeting differs from the other two are joined first.
    """
    ab, bc, ca, sheets = meets[0], meets[1], meets[2], meets[3]
    bits = 0
    for m in range(8):
        a, b, c = m & 1 != 0, m & 2 != 0, m & 4 != 0
        if sheets == 1:
            inside = a
        elif sheets == 2:
            inside = (a and b) if ab > 0 else (a or b)
        elif ab == bc and bc == ca:
            inside = (a and b and c) if ab > 0 else (a or b or c)
        else:
            odd = ab
            if ab == ca:
                a, c, odd = c, a, bc
            elif ab == bc:
                b, c, odd = c, b, ca
            inside = ((a and b) or c) if odd > 0 else ((a or b) and c)
        if inside:
            bits |= 1 << m
    return bits


@inner_kernel
def _sharing(
    patch: FloatArray, smooth: NDArray[np.bool_], around: NDArray[np.int64],
    sheet: NDArray[np.int64], lead: int, reach: float, tolerance: float,
) -> tuple[int, int]:
    """How many samples not yet in a sheet share that of sample `lead`, and a bit for each."""
    count, bits = 0, 0
    for m in range(len(around)):
        if sheet[m] != -1:
            continue
        r, same, gap = around[m], 0.0, 0.0
        for c in range(3):
            same += patch[r, 3 + c] * patch[lead, 3 + c]
            gap += (patch[r, c] - patch[lead, c]) ** 2
        if same < (SMOOTH_FACE_MIN_COSINE if smooth[r] and smooth[lead] else FLAT_FACE_MIN_COSINE):
            continue
        off = height_over_patch(patch, lead, reach, patch[r, 0], patch[r, 1], patch[r, 2])[0]
        if abs(off) < tolerance + SAME_SHEET_SLOPE * np.sqrt(gap):
            count += 1
            bits |= 1 << m
    return count, bits


@kernel
def _sort_kernel(
    patch: FloatArray, neighbours: NDArray[np.int32], usable: NDArray[np.bool_],
    smooth: NDArray[np.bool_], spacing: FloatArray, tolerance: float,
    counts: NDArray[np.uint8], member: NDArray[np.int32], solid: NDArray[np.uint8],
) -> None:
    many = neighbours.shape[1] + 1
    around, sheet = np.zeros(many, dtype=np.int64), np.zeros(many, dtype=np.int64)
    leads, meets = np.zeros(3, dtype=np.int64), np.zeros(4, dtype=np.int64)
    for n in range(len(patch)):
        reach, sheets = 2.0 * spacing[n], 0
        meets[0] = meets[1] = meets[2] = 0
        for m in range(many):
            around[m] = n if m == 0 else np.int64(neighbours[n, m - 1])
            sheet[m] = -1 if usable[around[m]] else -2
        while sheets < 3:
            # Of the next few samples, the one whose patch most others share defines the sheet.
            lead, most, shared, tried = -1, 0, 0, 0
            for m in range(many):
                if sheet[m] != -1 or tried == MAX_LEADS_TRIED:
                    continue
                tried += 1
                one = int(np.int64(around[m]))
                count, bits = _sharing(patch, smooth, around, sheet, one, reach, tolerance)
                if count > most:
                    lead, most, shared = one, count, bits
                if smooth[one]:
                    break
            if lead < 0:
                break
            for m in range(many):
                if shared >> m & 1 != 0:
                    sheet[m] = sheets
            # A sheet that meets another in neither way is not part of the body here.
            decided = sheets == 0 or most >= MIN_FACE_MEMBERS
            for s in range(sheets):
                own_offset, other_offset = 0.0, 0.0
                for m in range(many):
                    in_sheet = sheet[m] == sheets
                    if in_sheet or sheet[m] == s:
                        r, other = around[m], leads[s] if in_sheet else lead
                        x, y, z = patch[r, 0], patch[r, 1], patch[r, 2]
                        off = height_over_patch(patch, other, reach, x, y, z)[0]
                        own_offset += off if in_sheet else 0.0
                        other_offset += 0.0 if in_sheet else off
                pair = 0 if sheets == 1 else (2 if s == 0 else 1)
                meets[pair] = 1 if own_offset > 0.0 else -1
                decided = decided and own_offset * other_offset > 0.0
            if decided:
                leads[sheets] = lead
                count = 0
                for m in range(many):
                    if sheet[m] == sheets and count < MAX_FACE_MEMBERS:
                        member[n, sheets, count] = around[m]
                        count += 1
                sheets += 1
            else:
                for m in range(many):
                    if sheet[m] == sheets:
                        sheet[m] = -2
        meets[3] = sheets
        solid[n] = _solid_bits(meets)
        counts[n] = sheets
