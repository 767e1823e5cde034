"""The scalar Eikonal solver, the method the paper names; kept for comparison.

Source: Zhou et al. 2009, Eq. (2).

|∇d| = 1 by Gauss–Seidel fast sweeping with Godunov upwind differences (Zhao 2005,
doi:10.1090/S0025-5718-04-01678-3). It is of first order: its error grows with distance, where
closest points carried by the same sweeps (`sweep`) stay exact to a fraction of the pitch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.kernel import kernel

INACTIVE, ACTIVE, FROZEN = 0, 1, 2
MAX_SWEEP_ROUNDS = 50  # of eight orderings; bodies need two or three, mazes a few more


def solve_eikonal(
    distance: NDArray[np.float32], frozen: NDArray[np.bool_], pitch_mm: float,
    tolerance_mm: float = 1e-4,
) -> int:
    """Extend distances from frozen nodes over the rest, in place.

    distance : (nz, ny, nx) float32 [mm], unsigned; what it holds at nodes not frozen is ignored
    frozen : (nz, ny, nx) bool, nodes whose distance is known
    returns : rounds of eight orderings until none changed a node by more than the tolerance
    raises : InputError where no node is frozen
    """
    if not frozen.any():
        raise InputError("no node of the grid has a distance to start from",
                         hint="give the grid a finer pitch")
    np.copyto(distance, np.float32(np.inf), where=~frozen)
    state = np.where(_beside(frozen), ACTIVE, INACTIVE).astype(np.uint8)
    state[frozen] = FROZEN
    rounds, change = 0, np.inf
    while change > tolerance_mm and rounds < MAX_SWEEP_ROUNDS:
        change = _round_kernel(distance, state, pitch_mm, tolerance_mm)
        rounds += 1
    return rounds


def eikonal_distance(
    values: NDArray[np.float32], pitch_mm: float, tolerance_mm: float = 1e-4
) -> NDArray[np.float32]:
    """Signed distance to the zero level of any function on a grid, with its signs.

    Nodes next to the level are frozen at their distance to the plane through its crossings of
    the grid's lines.

    values : (nz, ny, nx) float32, positive inside
    returns : (nz, ny, nx) float32 [mm]
    raises : InputError where the values have one sign only
    """
    distance = np.full(values.shape, np.inf, dtype=np.float32)
    _crossings_kernel(np.ascontiguousarray(values, dtype=np.float32), distance, pitch_mm)
    solve_eikonal(distance, np.isfinite(distance), pitch_mm, tolerance_mm)
    np.copyto(distance, -distance, where=values <= 0)
    return distance


def _beside(frozen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    beside = np.zeros_like(frozen)
    for axis in range(3):
        here, there = np.moveaxis(beside, axis, 0), np.moveaxis(frozen, axis, 0)
        here[1:] |= there[:-1]
        here[:-1] |= there[1:]
    return beside


@kernel
def _crossings_kernel(
    values: NDArray[np.float32], distance: NDArray[np.float32], pitch: float
) -> None:
    nz, ny, nx = values.shape
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                v, total, least = float(values[k, j, i]), 0.0, 0.0
                for axis in range(3):
                    nearest = 2.0
                    for step in range(-1, 2, 2):
                        kn = k + step if axis == 0 else k
                        jn = j + step if axis == 1 else j
                        im = i + step if axis == 2 else i
                        if kn < 0 or jn < 0 or im < 0 or kn >= nz or jn >= ny or im >= nx:
                            continue
                        w = float(values[kn, jn, im])
                        if (v > 0.0) != (w > 0.0):
                            nearest = min(nearest, v / (v - w))
                    if nearest <= 1.0:
                        least = max(nearest, 1e-6)
                        total += 1.0 / (least * least)
                if total > 0.0:
                    distance[k, j, i] = np.float32(pitch / np.sqrt(total))


@kernel
def _round_kernel(
    distance: NDArray[np.float32], state: NDArray[np.uint8], pitch: float, tolerance: float
) -> float:
    """Sweep in all eight orderings; the largest change.

    A node is worked on only when a neighbour has come nearer since it was last (locking, Bak,
    McLaughlin & Renzi 2010, doi:10.1137/090749645): most visits would change nothing.
    """
    nz, ny, nx = distance.shape
    largest = 0.0
    for order in range(8):
        for kk in range(nz):
            k = kk if order & 4 == 0 else nz - 1 - kk
            for jj in range(ny):
                j = jj if order & 2 == 0 else ny - 1 - jj
                for ii in range(nx):
                    i = ii if order & 1 == 0 else nx - 1 - ii
                    if state[k, j, i] != ACTIVE:
                        continue
                    state[k, j, i] = INACTIVE
                    # The smaller neighbour along each axis, sorted a ≤ b ≤ c.
                    a = min(distance[k, j, max(i - 1, 0)], distance[k, j, min(i + 1, nx - 1)])
                    b = min(distance[k, max(j - 1, 0), i], distance[k, min(j + 1, ny - 1), i])
                    c = min(distance[max(k - 1, 0), j, i], distance[min(k + 1, nz - 1), j, i])
                    if a > b:
                        a, b = b, a
                    if b > c:
                        b, c = c, b
                    if a > b:
                        a, b = b, a
                    own = float(distance[k, j, i])
                    new = a + pitch
                    if new > b:
                        new = 0.5 * (a + b + np.sqrt(2.0 * pitch * pitch - (a - b) ** 2))
                        if new > c:
                            total = a + b + c
                            squares = a * a + b * b + c * c - pitch * pitch
                            new = (total + np.sqrt(total * total - 3.0 * squares)) / 3.0
                    if new >= own:
                        continue
                    distance[k, j, i] = np.float32(new)
                    largest = max(largest, own - new)
                    if own - new <= tolerance:
                        continue
                    for side in range(6):
                        kn = k + 1 if side == 0 else (k - 1 if side == 1 else k)
                        jn = j + 1 if side == 2 else (j - 1 if side == 3 else j)
                        im = i + 1 if side == 4 else (i - 1 if side == 5 else i)
                        if (
                            0 <= kn < nz and 0 <= jn < ny and 0 <= im < nx
                            and state[kn, jn, im] == INACTIVE and distance[kn, jn, im] > new
                        ):
                            state[kn, jn, im] = ACTIVE
    return largest
