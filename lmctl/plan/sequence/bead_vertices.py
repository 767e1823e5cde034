"""As few vertices of a bead as its shape, strip width and mixture allow."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel
from lmctl.plan.polyline import mark_kept_vertices
from lmctl.plan.sequence.track_order import OrderedTracks

#: Simplifying a path moves it by no more than this part of the bead width,
_TOLERANCE = 0.01
#: and its strip width by no more than this part of the pitch.
_STRIP_TOLERANCE = 0.03
#: Lengths nearer to each other than this are one vertex [mm].
_SAME_MM = 1e-6


def bead_vertices(
    tracks: OrderedTracks, fixed_mm: FloatArray, bead_mm: float, pitch_mm: float
) -> tuple[FloatArray, IndexArray]:
    """Lengths at which beads have vertices, (v,) rising, and where each track's begin, (m + 1,).

    Douglas-Peucker over x, y and the strip width, between the lengths `fixed_mm` (k,), which
    always stay, as do both ends of every track (D. H. Douglas and T. K. Peucker, 1973,
    DOI 10.3138/FM57-6770-U75U-7727).
    """
    tolerance_mm = _TOLERANCE * bead_mm
    strip = tracks.strip_width_mm * (tolerance_mm / (_STRIP_TOLERANCE * pitch_mm))
    inner_starts = np.searchsorted(fixed_mm, tracks.along_mm[tracks.starts[:-1]])
    vertices, starts = _vertices(
        np.ascontiguousarray(tracks.points_mm), strip, tracks.along_mm, tracks.starts, fixed_mm,
        np.append(inner_starts, len(fixed_mm)), tolerance_mm**2)
    return np.asarray(vertices), np.asarray(starts)


@kernel
def _vertices(
    points: FloatArray, strip: FloatArray, along: FloatArray, starts: IndexArray,
    fixed: FloatArray, fixed_starts: IndexArray, tolerance_sq: float,
) -> tuple[FloatArray, IndexArray]:
    most = len(along) + len(fixed)
    kept = np.empty(most)
    kept_starts = np.zeros(len(starts), np.int64)
    at = np.empty(most)
    place = np.empty((most, 3))
    stays = np.empty(most, np.bool_)
    stack = np.empty((most, 2), np.int64)
    count = 0
    for track in range(len(starts) - 1):
        v, end = starts[track], starts[track + 1]
        f, last = fixed_starts[track], fixed_starts[track + 1]
        n = 0
        while v < end or f < last:
            from_fixed = f < last and (v == end or fixed[f] <= along[v])
            length = fixed[f] if from_fixed else along[v]
            if n == 0 or length - at[n - 1] > _SAME_MM:
                at[n] = length
                stays[n] = from_fixed
                k = min(v, end - 1)
                t = 1.0
                if from_fixed and starts[track] < v < end:
                    t = (length - along[v - 1]) / (along[v] - along[v - 1])
                j = max(k - 1, starts[track])
                place[n, 0] = points[j, 0] + t * (points[k, 0] - points[j, 0])
                place[n, 1] = points[j, 1] + t * (points[k, 1] - points[j, 1])
                place[n, 2] = strip[j] + t * (strip[k] - strip[j])
                n += 1
            elif from_fixed:
                stays[n - 1] = True
            if from_fixed:
                f += 1
            else:
                v += 1
        stays[0] = stays[n - 1] = True
        mark_kept_vertices(place, tolerance_sq, stays, stack, n)
        for k in range(n):
            if stays[k]:
                kept[count] = at[k]
                count += 1
        kept_starts[track + 1] = count
    return kept[:count], kept_starts
