"""Values of a plane's nodes anywhere between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.plane import PlaneGrid


def interpolate_bilinear(values: NDArray[np.float32], grid: PlaneGrid,
                         points_mm: FloatArray) -> FloatArray:
    """Bilinear interpolation at points (n, 2) [mm]; beyond the edge, the edge's value. (n,)"""
    ny, nx = grid.shape
    u = np.clip((points_mm[:, 0] - grid.origin_mm[0]) / grid.pitch_mm, 0, nx - 1)
    v = np.clip((points_mm[:, 1] - grid.origin_mm[1]) / grid.pitch_mm, 0, ny - 1)
    i, j = np.minimum(u.astype(np.intp), nx - 2), np.minimum(v.astype(np.intp), ny - 2)
    u, v = u - i, v - j
    low = (1 - u) * values[j, i] + u * values[j, i + 1]
    high = (1 - u) * values[j + 1, i] + u * values[j + 1, i + 1]
    return np.asarray((1 - v) * low + v * high, dtype=np.float64)
