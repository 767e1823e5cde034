"""Round off the steps of a level field where the number of tracks across changes.

What is smoothed is how far levels and strips are from a plain pitch: a Gaussian mean over the
inside, blended in within a few nodes of a step and nowhere else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel

#: Standard deviation of the mean, and where it is cut off [nodes].
_SMOOTHING_NODES, _REACH_NODES = 2.0, 5
#: The level of a track on the axis is not reached by the field, so that no contour is cut there.
_BELOW_CENTRELINE = 0.25
#: Value of the tracks outside a core where no point of the axis was found: tracks lie a pitch apart
#: all the way.
NO_CORE_TRACK_COUNT = 1_000_000


def smoothing_bell() -> FloatArray:
    """Weights of the nodes around one, along a row or a column, (2 k + 1,); they add up to 1."""
    at = np.arange(-_REACH_NODES, _REACH_NODES + 1)
    weight = np.exp(-0.5 * (at / _SMOOTHING_NODES) ** 2)
    return np.asarray(weight / weight.sum())


@inner_kernel
def smooth_steps(
    level: NDArray[np.float32], strip: NDArray[np.float32], count: NDArray[np.int32],
    outer: NDArray[np.int32], depth: NDArray[np.float32], pitch: float, weight: FloatArray,
    wave: NDArray[np.float32],
) -> None:
    """Smooth levels and strips in place, keep levels below tracks on the axis, and fill `wave`.

    Arrays (ny, nx), as in `LevelField`
    """
    ny, nx = level.shape
    reach = len(weight) // 2
    near = np.zeros((ny, nx), np.float32)
    for j in range(1, ny):
        for i in range(1, nx):
            if depth[j, i] <= 0:
                continue
            steps = 0
            if depth[j - 1, i] > 0 and count[j - 1, i] != count[j, i]:
                steps += 1
            if depth[j, i - 1] > 0 and count[j, i - 1] != count[j, i]:
                steps += 1
            if steps == 0:
                continue
            for jn in range(max(0, j - reach), min(ny, j + reach + 1)):
                across = steps * 3 * _SMOOTHING_NODES * weight[jn - j + reach]
                for im in range(max(0, i - reach), min(nx, i + reach + 1)):
                    near[jn, im] += across * weight[im - i + reach]
    total = 0
    for j in range(ny):
        for i in range(nx):
            if near[j, i] > 0 and depth[j, i] > 0:
                total += 1
    smoothed = np.empty((total, 2))
    done = 0
    for j in range(ny):
        for i in range(nx):
            if near[j, i] <= 0 or depth[j, i] <= 0:
                continue
            share, change, wider = 0.0, 0.0, 0.0
            for jn in range(max(0, j - reach), min(ny, j + reach + 1)):
                for im in range(max(0, i - reach), min(nx, i + reach + 1)):
                    if depth[jn, im] > 0:
                        part = weight[jn - j + reach] * weight[im - i + reach]
                        share += part
                        change += part * (level[jn, im] - depth[jn, im] / pitch)
                        wider += part * (strip[jn, im] - pitch)
            most = min(near[j, i], 1.0)
            plain = depth[j, i] / pitch
            smoothed[done, 0] = level[j, i] + most * (plain + change / share - level[j, i])
            smoothed[done, 1] = strip[j, i] + most * (pitch + wider / share - strip[j, i])
            done += 1
    done = 0
    for j in range(ny):
        for i in range(nx):
            if depth[j, i] > 0:
                if near[j, i] > 0:
                    level[j, i], strip[j, i] = smoothed[done, 0], smoothed[done, 1]
                    done += 1
                if count[j, i] % 2 == 1:
                    level[j, i] = min(level[j, i], 0.5 * count[j, i] - _BELOW_CENTRELINE)
                elif count[j, i] == 0 and outer[j, i] < NO_CORE_TRACK_COUNT:
                    level[j, i] = min(level[j, i], _BELOW_CENTRELINE)
            here = max(float(level[j, i]), 0.0)
            whole = int(here)
            wave[j, i] = here - whole - 0.5 if whole % 2 == 0 else 0.5 + whole - here
