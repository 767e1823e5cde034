"""Composition given by voxels, as another program has exported it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.bodies.body import Body
from lmctl.part.materials.profiles import normalise_rows
from lmctl.part.sources.volumetric_3mf import Beyond, VoxelProperty

#: How far the fractions of a voxel in the part may be from summing to 1: two of 8 bits each.
SUM_TOLERANCE = 0.02
#: Voxels whose mixture is checked, evenly spread.
MAX_CHECKED = 200_000
#: A fraction so far below 0 is a mistake, not rounding.
_LEAST = -0.005


@dataclass(frozen=True, eq=False)
class SampledComposition:
    """Volume fractions between voxels. Voxels without any mixture take that of the nearest.

    padded : (n_materials, nx + 2, ny + 2, nz + 2), one voxel more at each end
    to_unit : (4, 3) from millimetres to the unit cube that the voxels fill
    """

    padded: FloatArray
    to_unit: FloatArray
    beyond: tuple[Beyond, Beyond, Beyond]
    is_linear: bool

    def fractions(self, points: FloatArray) -> FloatArray:
        n_voxels = np.array(self.padded.shape[1:]) - 2
        unit = np.column_stack([points, np.ones(len(points))]) @ self.to_unit
        index = unit * n_voxels - 0.5
        folded = np.stack([
            _folded(index[:, axis], int(n_voxels[axis]), self.beyond[axis]) for axis in range(3)])
        found = [map_coordinates(one, folded + 1.0, order=int(self.is_linear), prefilter=False)
                 for one in self.padded]
        return normalise_rows(np.stack(found, axis=1))


def sampled_composition(
    properties: Sequence[VoxelProperty], body: Body, what: str
) -> SampledComposition:
    """The composition of a body by one property for each material, in their order.

    what : the file, for people. Raises InputError where the voxels in the body are no mixture.
    """
    first = properties[0]
    if any(one.values.shape != first.values.shape or one.beyond != first.beyond
           or not np.allclose(one.to_unit, first.to_unit) for one in properties[1:]):
        raise InputError(f"the materials in {what} are sampled on different voxels",
                         hint="export all of them on one grid")
    values = np.stack([one.values for one in properties]).astype(np.float64)
    _check_mixtures(values, _centres_mm(first), body, what)
    padded = np.stack([_padded(one, first.beyond) for one in _filled(values)])
    return SampledComposition(padded, first.to_unit, first.beyond, first.is_linear)


def _check_mixtures(values: FloatArray, centres_mm: FloatArray, body: Body, what: str) -> None:
    every = -(-len(centres_mm) // MAX_CHECKED)
    inside = np.arange(0, len(centres_mm), every)
    inside = inside[body.distance_at(centres_mm[inside]) >= 0.0]
    if len(inside) == 0:
        raise InputError(
            f"{what} has no voxel in the body that it belongs to",
            where=f"its voxels lie from {_point(centres_mm.min(axis=0))} to "
                  f"{_point(centres_mm.max(axis=0))}",
            hint="see that body and mixture are placed alike")
    found = values.reshape(len(values), -1)[:, inside]
    off = np.abs(found.sum(axis=0) - 1.0)
    if off.max() > SUM_TOLERANCE:
        at = int(off.argmax())
        raise InputError(
            f"the volume fractions in {what} sum to {found[:, at].sum():.3f} at "
            f"{_point(centres_mm[inside[at]])}", where="in a part they sum to 1",
            hint="name a property for every material of the part, each from 0 to 1")
    if found.min() < _LEAST:
        at = int(found.min(axis=0).argmin())
        raise InputError(f"a volume fraction in {what} is {found.min():.3f} at "
                         f"{_point(centres_mm[inside[at]])}", hint="export fractions from 0 to 1")


def _filled(values: FloatArray) -> FloatArray:
    """Voxels outside the solid often hold nothing: there the nearest mixture goes on."""
    is_empty = np.abs(values.sum(axis=0) - 1.0) > SUM_TOLERANCE
    if not is_empty.any():
        return values
    nearest = distance_transform_edt(is_empty, return_distances=False, return_indices=True)
    return np.asarray(values[:, *nearest])


def _padded(values: FloatArray, beyond: tuple[Beyond, Beyond, Beyond]) -> FloatArray:
    """One voxel more at each end. Past a stack that just ends, the mixture of its edge goes on."""
    for axis, how in enumerate(beyond):
        n = values.shape[axis]
        ends = (n - 1, 0) if how is Beyond.WRAP else (0, n - 1)
        values = values.take([ends[0], *range(n), ends[1]], axis=axis)
    return values


def _folded(index: FloatArray, n: int, how: Beyond) -> FloatArray:
    """Positions along an axis, in voxels from the first's centre, brought to −1 … n."""
    if how is Beyond.WRAP:
        return np.asarray(np.mod(index + 0.5, n) - 0.5)
    if how is Beyond.MIRROR:
        back = np.mod(index + 0.5, 2 * n)
        return np.asarray(np.minimum(back, 2 * n - back) - 0.5)
    return np.asarray(np.clip(index, 0.0, n - 1.0))


def _centres_mm(one: VoxelProperty) -> FloatArray:
    """(n, 3) of the voxels' centres in the part."""
    axes = [(np.arange(n) + 0.5) / n for n in one.values.shape]
    unit = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray((unit - one.to_unit[3]) @ np.linalg.inv(one.to_unit[:3]))


def _point(at_mm: FloatArray) -> str:
    return " ".join(f"{axis}{value:.1f}" for axis, value in zip("XYZ", at_mm, strict=True))
