"""One step of the search for the nearest point at which surfaces meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel

#: The longest step, in pitches, and below which steps along and back to the surfaces are done.
MAX_STEP_PITCHES = 4.0
STEP_ALONG_TOLERANCE = 1e-4
STEP_BACK_TOLERANCE = 1e-6

#: Of the way to go at most this share is gone, and at least that.
MAX_STEP_FRACTION = 10.0
MIN_STEP_FRACTION = 0.01

#: Surfaces that cross at less than this angle [rad] count as one.
MIN_CROSSING_ANGLE_RAD = 1e-6


@kernel
def step_along(
    rows: IntArray, points: FloatArray, at: FloatArray, value: FloatArray, inward: FloatArray,
    before: FloatArray, pitch: float, first: bool, last: bool,
) -> NDArray[np.bool_]:
    """Move `at` towards `points` along their surfaces, and straight back onto these.

    rows : (r,) of points, at (n, 3) and before (n, 2, 3), which holds each one's last step along
        and the whole way it then had to go
    value, inward : (r, 3), (r, 3, 3), signed distances of the surfaces and their directions, zero
        where there is none
    first, last : whether nothing is known of `before` yet, and whether only to go back
    returns : (r,) whether there is more to go
    """
    is_moving = np.zeros(len(rows), dtype=np.bool_)
    base, along, back = np.empty((3, 3)), np.empty(3), np.empty(3)
    for r in range(len(rows)):
        n = rows[r]
        for c in range(3):
            along[c] = points[n, c] - at[n, c]
            back[c] = 0.0
        # Each direction less what those before it hold: what is across comes off the way, and the
        # way back is put together from the same parts.
        for k in range(3):
            left = value[r, k]
            for c in range(3):
                base[k, c] = inward[r, k, c]
                left -= inward[r, k, c] * back[c]
            for m in range(k):
                shared = base[k, 0] * base[m, 0] + base[k, 1] * base[m, 1] + base[k, 2] * base[m, 2]
                for c in range(3):
                    base[k, c] -= shared * base[m, c]
            size = np.sqrt(base[k, 0] ** 2 + base[k, 1] ** 2 + base[k, 2] ** 2)
            if size < MIN_CROSSING_ANGLE_RAD:
                for c in range(3):
                    base[k, c] = 0.0
                continue
            across = 0.0
            for c in range(3):
                base[k, c] /= size
                across += base[k, c] * along[c]
            for c in range(3):
                along[c] -= across * base[k, c]
                back[c] += left / size * base[k, c]
        share = 0.0 if last else 1.0
        if not (first or last):
            taken, bent = 0.0, 0.0
            for c in range(3):
                taken += before[n, 0, c] ** 2
                bent += before[n, 0, c] * (before[n, 1, c] - along[c])
            if bent > 1e-6 * taken:
                share = min(max(taken / bent, MIN_STEP_FRACTION), MAX_STEP_FRACTION)
        size, size_along, size_back = 0.0, 0.0, 0.0
        for c in range(3):
            before[n, 0, c] = share * along[c]
            before[n, 1, c] = along[c]
            size += (share * along[c] - back[c]) ** 2
            size_along += (share * along[c]) ** 2
            size_back += back[c] ** 2
        limit = min(1.0, MAX_STEP_PITCHES * pitch / max(np.sqrt(size), 1e-300))
        for c in range(3):
            at[n, c] += limit * (share * along[c] - back[c])
        is_moving[r] = (
            np.sqrt(size_along) > STEP_ALONG_TOLERANCE * pitch or np.sqrt(
                size_back) > STEP_BACK_TOLERANCE * pitch)
    return is_moving
