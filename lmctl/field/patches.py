"""The surface around every sample of a cloud: a small fitted patch.

Where a quadric explains the neighbourhood the patch is that quadric. Where none does an edge
runs through it, and the patch is the plane that most of the neighbours share with the sample:
a least-squares fit across an edge would round it off by the size of the neighbourhood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.field.samples import Samples

FloatArray = NDArray[np.float64]

FITTED = 16  # a quadric has six unknowns; 16 neighbours leave noise something to average over
CHUNK = 4096  # samples fitted at once: bounds the memory
FEWEST_SHARING = 6  # of 17 samples on a plane: fewer happen by chance where edges crowd
PAIRS = np.triu_indices(10, 1)  # planes tried near an edge: the sample and two of ten neighbours


@dataclass(frozen=True)
class Patches:
    """Fitted patches; patch i is {base + t + f(t) normal}, f(t) = bend of the tangential t.

    base_mm : (n, 3) float64, the sample moved onto its fit
    normal, tangent : (n, 3) float64, unit, perpendicular to each other; the side the normal
        points to means nothing yet
    bend : (n, 3) float64 [1/mm], f = b0 u² + b1 u v + b2 v², u along tangent, v along
        normal × tangent
    smooth : (n,) bool, a quadric explains the whole neighbourhood
    trusted : (n,) bool, enough of the neighbourhood lies on the patch to believe it
    noise_mm : root mean square of the samples' distance from smooth patches
    tolerance_mm : how far from its patch a sample of the same sheet may lie
    """

    base_mm: FloatArray
    normal: FloatArray
    tangent: FloatArray
    bend: FloatArray
    smooth: NDArray[np.bool_]
    trusted: NDArray[np.bool_]
    noise_mm: float
    tolerance_mm: float


def fit_patches(samples: Samples) -> Patches:
    """Fit every sample's patch to its 16 neighbours; deterministic."""
    n = len(samples.points_mm)
    base, normal, tangent = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    bend, residual = np.empty((n, 3)), np.empty(n)
    chunks = [slice(a, min(a + CHUNK, n)) for a in range(0, n, CHUNK)]
    for part in chunks:
        around = _around(samples, np.arange(part.start, part.stop))
        base[part], normal[part], tangent[part], bend[part], residual[part] = _quadrics(around)
        base[part] += samples.points_mm[part]
    # Edges are the minority of the neighbourhoods, so a low quantile is the noise of the rest.
    noise = max(1.3 * float(np.quantile(residual, 0.3)), 0.01 * samples.typical_spacing_mm)
    smooth = (residual < 1.6 * noise) & (
        np.abs(bend).max(axis=1) * samples.spacing_mm < 0.25
    )
    tolerance = max(4.0 * noise, 0.05 * samples.typical_spacing_mm)
    trusted = smooth.copy()
    edge = np.flatnonzero(~smooth)
    for a in range(0, len(edge), CHUNK // 4):
        rows = edge[a : a + CHUNK // 4]
        offset, normal[rows], sharing = _shared_planes(_around(samples, rows), tolerance)
        trusted[rows] = sharing >= FEWEST_SHARING
        base[rows] = samples.points_mm[rows] + offset[:, None] * normal[rows]
        tangent[rows] = _perpendicular(normal[rows])
        bend[rows] = 0.0
    return Patches(base, normal, tangent, bend, smooth, trusted, noise, tolerance)


def _around(samples: Samples, rows: NDArray[np.int64]) -> FloatArray:
    """(m, 17, 3): each sample (at 0) and its neighbours, relative to it."""
    points = samples.points_mm
    offsets: FloatArray = points[samples.neighbours[rows, :FITTED]] - points[rows][:, None]
    return np.concatenate([np.zeros((len(rows), 1, 3)), offsets], axis=1)


def _nearness(around: FloatArray) -> FloatArray:
    """(m, 17) weights, 1 at the sample and falling towards the last neighbour."""
    squared = (around * around).sum(axis=2)
    weights: FloatArray = (1.0 - squared / (1.2 * squared.max(axis=1, keepdims=True))) ** 2
    return weights


def _along(around: FloatArray, direction: FloatArray) -> FloatArray:
    """Each point's component along its sample's direction: (m, 17)."""
    component: FloatArray = (around @ direction[:, :, None])[:, :, 0]
    return component


def _plane(around: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted least-squares planes: centres (m, 3) and unit normals (m, 3)."""
    total = weights.sum(axis=1)
    centre = (weights[:, None] @ around)[:, 0] / total[:, None]
    local = around - centre[:, None]
    spread = (local * weights[:, :, None]).transpose(0, 2, 1) @ local
    return centre, _least_axis(spread)


def _least_axis(spread: FloatArray) -> FloatArray:
    """Unit eigenvector of the least eigenvalue of symmetric matrices (m, 3, 3).

    In closed form (O. K. Smith 1961, doi:10.1145/355578.366316): the vector is perpendicular to
    the rows of A − λI, so it is the longest of their cross products.
    """
    scale = np.abs(spread).max(axis=(1, 2), keepdims=True)
    a = spread / np.where(scale > 0.0, scale, 1.0)
    mean = (a[:, 0, 0] + a[:, 1, 1] + a[:, 2, 2]) / 3.0
    b = a - mean[:, None, None] * np.eye(3)
    size = np.sqrt((b * b).sum(axis=(1, 2)) / 6.0)
    det = (np.cross(b[:, 0], b[:, 1]) * b[:, 2]).sum(axis=1)
    ratio = np.clip(det / (2.0 * np.maximum(size, 1e-12) ** 3), -1.0, 1.0)
    least = mean + 2.0 * size * np.cos(np.arccos(ratio) / 3.0 + 2.0 * np.pi / 3.0)
    rows = a - least[:, None, None] * np.eye(3)
    across = np.cross(rows, np.roll(rows, -1, axis=1))
    squared = (across * across).sum(axis=2)
    best = squared.argmax(axis=1)
    at = np.arange(len(a))
    axis = across[at, best] / np.sqrt(np.maximum(squared[at, best], 1e-300))[:, None]
    # All rows parallel: the points are on a line, and any perpendicular will do.
    return np.where(squared[at, best][:, None] > 1e-24, axis, [0.0, 0.0, 1.0])


def _quadrics(
    around: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Heights over the least-squares plane, fitted by 1, u, v, u², uv, v²."""
    weights = _nearness(around)
    _, up = _plane(around, weights)
    side = _perpendicular(up)
    across = np.cross(up, side)
    scale = np.sqrt((around * around).sum(axis=2).max(axis=1))[:, None]
    u, v, height = _along(around, side), _along(around, across), _along(around, up)
    u, v = u / scale, v / scale
    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    weighted = (basis * weights[:, :, None]).transpose(0, 2, 1)
    normal_matrix = weighted @ basis + 1e-9 * np.eye(6)
    coefficients = np.linalg.solve(normal_matrix, weighted @ height[:, :, None])
    misfit = height - (basis @ coefficients)[:, :, 0]
    coefficients = coefficients[:, :, 0]
    freedom = 1.0 - 6.0 / around.shape[1]
    residual = np.sqrt((weights * misfit**2).sum(axis=1) / (weights.sum(axis=1) * freedom))
    slope_u, slope_v = coefficients[:, 1:2] / scale, coefficients[:, 2:3] / scale
    normal = up - slope_u * side - slope_v * across
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangent = side - (side * normal).sum(axis=1, keepdims=True) * normal
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    base = coefficients[:, :1] * up
    return base, normal, tangent, coefficients[:, 3:] / scale**2, residual


def _shared_planes(
    around: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """The plane through each sample that most neighbours share, refined over those.

    returns : (m,) offset of the plane from the sample along the normal, (m, 3) normals,
        (m,) number of samples that share it
    """
    near = _nearness(around)
    first, second = around[:, 1 + PAIRS[0]], around[:, 1 + PAIRS[1]]
    tried = np.cross(first, second)
    size = np.linalg.norm(tried, axis=2)
    broad = size > 0.3 * np.linalg.norm(first, axis=2) * np.linalg.norm(second, axis=2)
    tried /= np.where(size > 0.0, size, 1.0)[:, :, None]
    misses = tried @ (around / tolerance).transpose(0, 2, 1)
    score = (np.maximum(0.0, 1.0 - misses * misses) @ near[:, :, None])[:, :, 0]
    best = np.argmax(np.where(broad, score, -1.0), axis=1)
    normal = tried[np.arange(len(around)), best]
    offset = np.zeros(len(around))
    for _ in range(2):
        miss = (_along(around, normal) - offset[:, None]) / tolerance
        weights = near * np.maximum(0.0, 1.0 - miss**2) ** 2
        centre, refined = _plane(around, weights + 1e-12)
        offset_now = (centre * refined).sum(axis=1)
        # A refinement that turns away, or leaves its own sample, has been caught by an edge.
        turned = np.abs((refined * normal).sum(axis=1))
        kept = (turned > 0.9) & (np.abs(offset_now) < tolerance)
        normal = np.where(kept[:, None], refined, normal)
        offset = np.where(kept, offset_now, offset)
    miss = _along(around, normal) - offset[:, None]
    return offset, normal, np.count_nonzero(np.abs(miss) < tolerance, axis=1)


def _perpendicular(normal: FloatArray) -> FloatArray:
    """Some unit vector perpendicular to each normal."""
    other = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    tangent = np.cross(normal, other)
    return np.asarray(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))
