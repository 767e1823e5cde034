"""Round off the steps of a level field, where the number of tracks changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel

#: Standard deviation of what rounds off steps [nodes].
_SMOOTHING_NODES = 2.0


def smoothing_bell() -> FloatArray:
    """Weights of the nodes around one, along a row or a column, (2 k + 1,); they add up to 1."""
    far = round(2.5 * _SMOOTHING_NODES)
    weight = np.exp(-np.arange(-far, far + 1) ** 2 / (2 * _SMOOTHING_NODES**2))
    return np.asarray(weight / weight.sum())


@inner_kernel
def smooth_steps(
    level: NDArray[np.float32], strip: NDArray[np.float32], count: NDArray[np.int32],
    depth: NDArray[np.float32], pitch: float, bell: FloatArray,
) -> None:
    """Round off, in place, the steps where the number of tracks changes.

    What is smoothed is how far levels and strips are from a plain pitch, inside only. Steps spread
    a weight, 1 on them and falling to 0; with it nodes take on the mean of those around.
    """
    ny, nx = count.shape
    far = len(bell) // 2
    near = np.zeros((ny, nx), np.float32)
    stepped = False
    for j in range(ny):
        for i in range(nx):
            step = 0
            if depth[j, i] > 0:
                step += j > 0 and depth[j - 1, i] > 0 and count[j, i] != count[j - 1, i]
                step += i > 0 and depth[j, i - 1] > 0 and count[j, i] != count[j, i - 1]
            if step == 0:
                continue
            stepped = True
            for v in range(max(j - far, 0), min(j + far + 1, ny)):
                for u in range(max(i - far, 0), min(i + far + 1, nx)):
                    near[v, u] += step * bell[v - j + far] * bell[u - i + far]
    if not stepped:
        return
    before, strip_before = level.copy(), strip.copy()
    for j in range(ny):
        for i in range(nx):
            if near[j, i] <= 0 or depth[j, i] <= 0:
                continue
            weight = change = strip_change = 0.0
            for v in range(max(j - far, 0), min(j + far + 1, ny)):
                for u in range(max(i - far, 0), min(i + far + 1, nx)):
                    if depth[v, u] > 0:
                        share = bell[v - j + far] * bell[u - i + far]
                        weight += share
                        change += share * (before[v, u] - depth[v, u] / pitch)
                        strip_change += share * (strip_before[v, u] - pitch)
            part = min(near[j, i] * 3 * _SMOOTHING_NODES, 1.0)
            level[j, i] += part * (change / weight - (before[j, i] - depth[j, i] / pitch))
            strip[j, i] += part * (strip_change / weight - (strip_before[j, i] - pitch))
