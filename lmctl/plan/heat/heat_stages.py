"""Conduct heat between cells for a step of time, in explicit stages.

Finite volumes, C dT/dt = Σ G (T_neighbour − T) (S. V. Patankar, Numerical Heat Transfer and Fluid
Flow, 1980, chapter 4). The longest plain explicit step is short, since it is set by the narrowest
cell of what conducts best. A step of s stages may be (s² + s)/2 times as long, for the work of s
plain ones: its stages are Legendre polynomials of a plain step (RKL1: C. D. Meyer, D. S. Balsara,
T. D. Aslam, J. Comput. Phys. 257 (2014) 594). It neither makes nor loses heat.
"""

from __future__ import annotations

import math

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel
from lmctl.plan.heat.cell_body import conduct


def stages_of(step_s: float, stable_s: float) -> int:
    """Stages that a step needs, where plain steps are stable up to `stable_s`."""
    return max(1, math.ceil(math.sqrt(2 * step_s / stable_s + 0.25) - 0.5 - 1e-9))


@inner_kernel
def stage_weights(stage: int, stages: int) -> tuple[float, float, float]:
    """Of temperatures now and of those a stage ago, and the part of the step to conduct for."""
    now = (2 * stage - 1) / stage
    return now, (1 - stage) / stage, now * 2 / (stages * stages + stages)


@inner_kernel
def step_fine_cells(
    fine: tuple[FloatArray, ...], new: FloatArray, n: int, part_from: int, box: IndexArray,
    ambient_K: float, lasting_s: float, stages: int, came_J: FloatArray,
) -> None:
    """Advance the fine cells over slab 0, whose temperature stays.

    came_J : (2, ny, nx), the first of which is written: the heat that came from slab 0
    """
    t, inverse, east, north, up, loss = fine[0], fine[3], fine[6], fine[7], fine[8], fine[9]
    ny = t.shape[1]
    came_J[:] = 0.0
    new[0] = t[0]
    a, b = t, new
    for stage in range(1, stages + 1):
        now, before, part = stage_weights(stage, stages)
        add_heat(came_J[(stage + 1) % 2], came_J[stage % 2], up[0], a[0], a[1], now, before,
                 part * lasting_s)
        conduct(a, b, inverse, east, north, up, loss, 1, part_from - 1, 1, ny - 1, ambient_K,
                now, before, part * lasting_s)
        conduct(a, b, inverse, east, north, up, loss, part_from, n, box[0], box[1], ambient_K,
                now, before, part * lasting_s)
        a, b = b, a
    if stages % 2 == 1:
        t[1:n + 1] = new[1:n + 1]
        came_J[0] = came_J[1]


@inner_kernel
def add_heat(
    came: FloatArray, came_new: FloatArray, up: FloatArray, below: FloatArray, above: FloatArray,
    now: float, before: float, lasting_s: float,
) -> None:
    """The heat that came from below so far, after one more stage; all (ny, nx)."""
    old, new, u = came.reshape(-1), came_new.reshape(-1), up.reshape(-1)
    under, over = below.reshape(-1), above.reshape(-1)
    of_now, of_before, step_s = np.float32(now), np.float32(before), np.float32(lasting_s)
    for m in range(np.uint64(len(old))):
        new[m] = of_now * old[m] + of_before * new[m] + step_s * u[m] * (under[m] - over[m])


@inner_kernel
def step_deep_cells(
    deep: tuple[FloatArray, ...], new: FloatArray, n: int, went_J: FloatArray, above: FloatArray,
    coarse_x: IndexArray, coarse_y: IndexArray, ambient_K: float, lasting_s: float, stages: int,
) -> None:
    """Take from the deep cells the heat that went to the fine ones, (ny, nx), advance them, and
    tell the fine ones their temperature, `above` (ny, nx)."""
    t, inverse, east, north, up, loss = deep[0], deep[3], deep[6], deep[7], deep[8], deep[9]
    ny, nx = went_J.shape
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            jj, ii = coarse_y[j], coarse_x[i]
            t[n, jj, ii] -= went_J[j, i] * inverse[n, jj, ii]
    new[0] = t[0]
    a, b = t, new
    for stage in range(1, stages + 1):
        now, before, part = stage_weights(stage, stages)
        conduct(a, b, inverse, east, north, up, loss, 1, n, 1, t.shape[1] - 1, ambient_K, now,
                before, part * lasting_s)
        a, b = b, a
    if stages % 2 == 1:
        t[1:n + 1] = new[1:n + 1]
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            above[j, i] = t[n, coarse_y[j], coarse_x[i]]
