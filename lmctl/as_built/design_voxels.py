"""The design at the centres of voxels: the part's own distance and composition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: Points evaluated at a time.
_POINTS_AT_ONCE = 500_000
#: Side of the blocks that are decided by the distance at their middle alone, in voxels.
_BLOCK = 4


@dataclass(frozen=True)
class DesignVoxels:
    """(nx, ny, nz) voxels.

    distance_mm : float32, signed distance at the centre, positive inside; that of the middle of a
        block that lies wholly on one side of the surface and of the core's
    inside : float32, share of the voxel that lies inside, 0 to 1
    rows : (m,) flat indices of the voxels whose centre is inside
    fractions : (m, n_materials) volume fractions at these centres
    """

    distance_mm: NDArray[np.float32]
    inside: NDArray[np.float32]
    rows: IndexArray
    fractions: FloatArray


def design_on_voxels(
    part: Part, corner_mm: FloatArray, voxel_mm: FloatArray, shape: tuple[int, int, int],
    core_mm: float,
) -> DesignVoxels:
    """The part on voxels.

    corner_mm : (3,) lowest corner, in the part's own coordinates
    core_mm : a depth that voxels are sorted by too
    """
    distance = _distance(part, corner_mm, voxel_mm, shape, core_mm)
    inside = np.clip(distance / np.float32(voxel_mm.mean()) + np.float32(0.5), 0, 1)
    rows = np.flatnonzero(distance.ravel() >= 0)
    fractions = np.empty((len(rows), len(part.materials)))
    for at in range(0, len(rows), _POINTS_AT_ONCE):
        some = rows[at : at + _POINTS_AT_ONCE]
        fractions[at : at + len(some)] = part.composition(
            _centres(some, corner_mm, voxel_mm, shape))
    return DesignVoxels(distance, inside, rows, fractions)


def _distance(
    part: Part, corner_mm: FloatArray, voxel_mm: FloatArray, shape: tuple[int, int, int],
    core_mm: float,
) -> NDArray[np.float32]:
    """Distance at every centre. A block is as deep as its middle says, give or take its own size:
    only those near the surface and near the core's are looked into."""
    blocks = (-(-shape[0] // _BLOCK), -(-shape[1] // _BLOCK), -(-shape[2] // _BLOCK))
    coarse = _at(part, np.arange(int(np.prod(blocks))), corner_mm, _BLOCK * voxel_mm, blocks)
    spread = np.repeat(np.repeat(np.repeat(
        coarse.reshape(blocks), _BLOCK, 0), _BLOCK, 1), _BLOCK, 2)
    distance = spread[: shape[0], : shape[1], : shape[2]].copy()
    reach = float(np.linalg.norm(_BLOCK * voxel_mm)) / 2 + float(voxel_mm.max())
    flat = distance.ravel()
    near = np.flatnonzero((np.abs(flat) <= reach) | (np.abs(flat - core_mm) <= reach))
    distance.ravel()[near] = _at(part, near, corner_mm, voxel_mm, shape)
    return distance


def _at(
    part: Part, rows: IndexArray, corner_mm: FloatArray, voxel_mm: FloatArray,
    shape: tuple[int, int, int],
) -> NDArray[np.float32]:
    found = np.empty(len(rows), dtype=np.float32)
    for at in range(0, len(rows), _POINTS_AT_ONCE):
        some = rows[at : at + _POINTS_AT_ONCE]
        found[at : at + len(some)] = part.body.distance_at(
            _centres(some, corner_mm, voxel_mm, shape))
    return found


def _centres(
    rows: IndexArray, corner_mm: FloatArray, voxel_mm: FloatArray, shape: tuple[int, int, int]
) -> FloatArray:
    """Centres of voxels, (n, 3), by their flat indices."""
    place = np.stack(np.unravel_index(rows, shape), axis=1) + 0.5
    return np.asarray(corner_mm + place * voxel_mm)
