"""A quadric, or the plane of most, through each sample's neighbours: the kernels of `patches`.

What numpy would do in batches of (m, 17, 3) arrays takes a fifth of the time sample by sample.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel

# a quadric has six unknowns; 16 neighbours leave noise something to average over
FIT_NEIGHBOURS = 16
# planes tried near an edge: the sample and two of so many neighbours
PLANE_CANDIDATE_NEIGHBOURS = 10
# sine of the angle at the sample from which on three points make a plane
MIN_PLANE_ANGLE_SINE = 0.3


@kernel
def fit_quadrics(
    points: FloatArray, neighbours: NDArray[np.int32], base: FloatArray, normal: FloatArray,
    tangent: FloatArray, bend: FloatArray, residual: FloatArray,
) -> None:
    """Heights over the least-squares plane, fitted by 1, u, v, u², uv, v²; fills the last five.

    points : (n, 3) float64; neighbours : (n, ≥ 16) int32
    base, normal, tangent, bend : as in `patches.FittedPatches`; residual : (n,), weighted rms
    misfit
    """
    around, weights = np.zeros((FIT_NEIGHBOURS + 1, 3)), np.empty(FIT_NEIGHBOURS + 1)
    up, side, over = np.empty(3), np.empty(3), np.empty(3)
    terms, heights = np.ones((FIT_NEIGHBOURS + 1, 6)), np.empty(FIT_NEIGHBOURS + 1)
    matrix, right = np.empty((6, 6)), np.empty(6)
    for n in range(len(points)):
        far = _gather(points, neighbours, n, around, weights)
        least_squares_plane(around, weights, up)
        set_perpendicular(up, side)
        _cross(up, side, over)
        scale = 1.0 / np.sqrt(far)
        ux, uy, uz = scale * side[0], scale * side[1], scale * side[2]
        vx, vy, vz = scale * over[0], scale * over[1], scale * over[2]
        # Sums of w uᵖ vᵠ: every product of two terms is one of fifteen.
        s00 = s10 = s01 = s20 = s11 = s02 = s30 = s21 = s12 = s03 = 0.0
        s40 = s31 = s22 = s13 = s04 = 0.0
        h00 = h10 = h01 = h20 = h11 = h02 = 0.0
        for m in range(FIT_NEIGHBOURS + 1):
            x, y, z, w = around[m, 0], around[m, 1], around[m, 2], weights[m]
            u, v = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
            h = up[0] * x + up[1] * y + up[2] * z
            uu, uv, vv = u * u, u * v, v * v
            heights[m] = h
            terms[m, 1], terms[m, 2] = u, v
            terms[m, 3], terms[m, 4], terms[m, 5] = uu, uv, vv
            wu, wv, wuu, wuv, wvv, wh = w * u, w * v, w * uu, w * uv, w * vv, w * h
            s00, s10, s01 = s00 + w, s10 + wu, s01 + wv
            s20, s11, s02 = s20 + wuu, s11 + wuv, s02 + wvv
            s30, s21, s12, s03 = s30 + wuu * u, s21 + wuu * v, s12 + wvv * u, s03 + wvv * v
            s40, s31, s22 = s40 + wuu * uu, s31 + wuu * uv, s22 + wuu * vv
            s13, s04 = s13 + wvv * uv, s04 + wvv * vv
            h00, h10, h01 = h00 + wh, h10 + wh * u, h01 + wh * v
            h20, h11, h02 = h20 + wh * uu, h11 + wh * uv, h02 + wh * vv
        total = s00
        matrix[0, 0], matrix[1, 0], matrix[2, 0] = s00, s10, s01
        matrix[3, 0], matrix[4, 0], matrix[5, 0] = s20, s11, s02
        matrix[1, 1], matrix[2, 1], matrix[3, 1] = s20, s11, s30
        matrix[4, 1], matrix[5, 1] = s21, s12
        matrix[2, 2], matrix[3, 2], matrix[4, 2], matrix[5, 2] = s02, s21, s12, s03
        matrix[3, 3], matrix[4, 3], matrix[5, 3] = s40, s31, s22
        matrix[4, 4], matrix[5, 4], matrix[5, 5] = s22, s13, s04
        right[0], right[1], right[2] = h00, h10, h01
        right[3], right[4], right[5] = h20, h11, h02
        _solve(matrix, right)
        missed = 0.0
        for m in range(FIT_NEIGHBOURS + 1):
            missed += weights[m] * (heights[m] - _dot(terms[m], right)) ** 2
        residual[n] = np.sqrt(missed / (total * (1.0 - 6.0 / (FIT_NEIGHBOURS + 1))))
        for c in range(3):
            base[n, c] = points[n, c] + right[0] * up[c]
            normal[n, c] = up[c] - scale * (right[1] * side[c] + right[2] * over[c])
            bend[n, c] = right[3 + c] * scale * scale
        _to_unit(normal[n])
        along = _dot(side, normal[n])
        for c in range(3):
            tangent[n, c] = side[c] - along * normal[n, c]
        _to_unit(tangent[n])


@kernel
def fit_shared_planes(
    points: FloatArray, neighbours: NDArray[np.int32], rows: NDArray[np.int64],
    tolerance: float, base: FloatArray, normal: FloatArray, tangent: FloatArray,
    bend: FloatArray, sharing: NDArray[np.int64],
) -> None:
    """The plane through each sample of `rows` that most neighbours share, refined over those.

    sharing : (n,), on return how many of the 17 lie on the plane
    """
    around, weights = np.zeros((FIT_NEIGHBOURS + 1, 3)), np.empty(FIT_NEIGHBOURS + 1)
    near, squared = np.empty(FIT_NEIGHBOURS + 1), np.empty(PLANE_CANDIDATE_NEIGHBOURS + 1)
    tried, best = np.empty(3), np.empty(3)
    for n in rows:
        _gather(points, neighbours, n, around, near)
        most = -2.0
        for m in range(1, PLANE_CANDIDATE_NEIGHBOURS + 1):
            squared[m] = _dot(around[m], around[m])
        for one in range(1, PLANE_CANDIDATE_NEIGHBOURS):
            for two in range(one + 1, PLANE_CANDIDATE_NEIGHBOURS + 1):
                _cross(around[one], around[two], tried)
                size = _dot(tried, tried)
                score = -1.0
                if size > MIN_PLANE_ANGLE_SINE * MIN_PLANE_ANGLE_SINE * squared[one] * squared[two]:
                    score, fine = 0.0, 1.0 / (np.sqrt(size) * tolerance)
                    x, y, z = tried[0] * fine, tried[1] * fine, tried[2] * fine
                    for m in range(FIT_NEIGHBOURS + 1):
                        miss = x * around[m, 0] + y * around[m, 1] + z * around[m, 2]
                        score += near[m] * max(0.0, 1.0 - miss * miss)
                if score > most:
                    most = score
                    for c in range(3):
                        best[c] = tried[c] / max(np.sqrt(size), 1e-300)
        offset = 0.0
        for _ in range(2):
            for m in range(FIT_NEIGHBOURS + 1):
                miss = (_dot(around[m], best) - offset) / tolerance
                weights[m] = near[m] * max(0.0, 1.0 - miss * miss) ** 2 + 1e-12
            now = least_squares_plane(around, weights, tried)
            # A refinement that turns away or leaves its own sample has crossed an edge.
            if abs(_dot(tried, best)) > 0.9 and abs(now) < tolerance:
                offset = now
                for c in range(3):
                    best[c] = tried[c]
        count = 0
        for m in range(FIT_NEIGHBOURS + 1):
            count += abs(_dot(around[m], best) - offset) < tolerance
        sharing[n] = count
        set_perpendicular(best, tangent[n])
        for c in range(3):
            base[n, c] = points[n, c] + offset * best[c]
            normal[n, c], bend[n, c] = best[c], 0.0


@inner_kernel
def least_squares_plane(around: FloatArray, weights: FloatArray, up: FloatArray) -> float:
    """Set `up` to the unit normal of the weighted plane; its offset along that from the origin.

    The eigenvector of the least eigenvalue λ of the points' spread A, in closed form (O. K. Smith
    1961, doi:10.1145/355578.366316): it is perpendicular to the rows of A − λI, so it is the
    longest of their cross products.
    """
    total, cx, cy, cz = 0.0, 0.0, 0.0, 0.0
    for m in range(len(around)):
        total += weights[m]
        cx, cy = cx + weights[m] * around[m, 0], cy + weights[m] * around[m, 1]
        cz += weights[m] * around[m, 2]
    cx, cy, cz = cx / total, cy / total, cz / total
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(len(around)):
        x, y, z = around[m, 0] - cx, around[m, 1] - cy, around[m, 2] - cz
        wx, wy = weights[m] * x, weights[m] * y
        xx, xy, xz, yy, yz = xx + wx * x, xy + wx * y, xz + wx * z, yy + wy * y, yz + wy * z
        zz += weights[m] * z * z
    size = max(xx, yy, zz, 1e-300)
    xx, xy, xz, yy, yz, zz = xx / size, xy / size, xz / size, yy / size, yz / size, zz / size
    mean = (xx + yy + zz) / 3.0
    xx, yy, zz = xx - mean, yy - mean, zz - mean
    squares = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz)
    spread = max(np.sqrt(squares / 6.0), 1e-12)
    volume = (
        (xy * yz - xz * yy) * xz + (xz * xy - xx * yz) * yz + (xx * yy - xy * xy) * zz
    )
    ratio = min(max(volume / (2.0 * spread**3), -1.0), 1.0)
    least = 2.0 * spread * np.cos(np.arccos(ratio) / 3.0 + 2.0 * np.pi / 3.0)
    xx, yy, zz = xx - least, yy - least, zz - least
    longest = 1e-24  # shorter: the points are on a line, and any perpendicular will do
    up[0], up[1], up[2] = 0.0, 0.0, 1.0
    for pair in range(3):
        if pair == 0:
            x, y, z = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
        elif pair == 1:
            x, y, z = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
        else:
            x, y, z = yz * xz - zz * xy, zz * xx - xz * xz, xz * xy - yz * xx
        squared = x * x + y * y + z * z
        if squared > longest:
            longest, length = squared, np.sqrt(squared)
            up[0], up[1], up[2] = x / length, y / length, z / length
    return float(cx * up[0] + cy * up[1] + cz * up[2])


@inner_kernel
def set_perpendicular(normal: FloatArray, tangent: FloatArray) -> None:
    """Set `tangent` to some unit vector perpendicular to the normal."""
    least = 0
    for c in range(1, 3):
        if abs(normal[c]) < abs(normal[least]):
            least = c
    for c in range(3):
        tangent[c] = -normal[c] * normal[least]
    tangent[least] += 1.0
    _to_unit(tangent)


@inner_kernel
def _gather(
    points: FloatArray, neighbours: NDArray[np.int32], n: int, around: FloatArray,
    weights: FloatArray,
) -> float:
    """Sample n (at 0) and its neighbours, relative to it; weights fall from 1 towards the last.

    returns : squared distance of the farthest
    """
    far = 0.0
    weights[0] = 0.0
    for m in range(FIT_NEIGHBOURS):
        r = neighbours[n, m]
        for c in range(3):
            around[m + 1, c] = points[r, c] - points[n, c]
        weights[m + 1] = _dot(around[m + 1], around[m + 1])
        far = max(far, weights[m + 1])
    for m in range(FIT_NEIGHBOURS + 1):
        weights[m] = (1.0 - weights[m] / (1.2 * far)) ** 2
    return far


@inner_kernel
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """By Cholesky on the lower triangle, in place; `right` becomes the answer."""
    size = len(right)
    for a in range(size):
        matrix[a, a] += 1e-9  # neighbours on a line leave some terms undetermined
        for b in range(a + 1):
            total = matrix[a, b]
            for c in range(b):
                total -= matrix[a, c] * matrix[b, c]
            matrix[a, b] = np.sqrt(max(total, 1e-12)) if a == b else total / matrix[b, b]
        for c in range(a):
            right[a] -= matrix[a, c] * right[c]
        right[a] /= matrix[a, a]
    for a in range(size - 1, -1, -1):
        for c in range(a + 1, size):
            right[a] -= matrix[c, a] * right[c]
        right[a] /= matrix[a, a]


@inner_kernel
def _cross(a: FloatArray, b: FloatArray, result: FloatArray) -> None:
    result[0] = a[1] * b[2] - a[2] * b[1]
    result[1] = a[2] * b[0] - a[0] * b[2]
    result[2] = a[0] * b[1] - a[1] * b[0]


@inner_kernel
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for c in range(len(a)):
        total += a[c] * b[c]
    return total


@inner_kernel
def _to_unit(vector: FloatArray) -> None:
    size = np.sqrt(_dot(vector, vector))
    for c in range(len(vector)):
        vector[c] /= size
