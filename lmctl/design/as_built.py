"""The composition that a run has built, from the voxel map it left.

The map is described in docs/reference/voxel-map.md; it is in machine coordinates.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt

from lmctl.array_types import FloatArray
from lmctl.errors import InputError

_FORMAT = "voxel-map-1"


@dataclass(frozen=True, eq=False)
class AsBuiltComposition:
    """Volume fractions that were built, constant in each voxel.

    origin_mm, voxel_mm : (3,); points are asked in the same coordinates
    fractions : (nx, ny, nz, n_materials); voxels with nothing in them have those of the nearest
    filled_share : (nx, ny, nz), volume of the materials over that of the voxel
    """

    origin_mm: FloatArray
    voxel_mm: FloatArray
    fractions: FloatArray
    filled_share: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Volume fractions (n, n_materials) at points (n, 3) [mm]; outside, the nearest voxel's."""
        last = np.array(self.fractions.shape[:3]) - 1
        cell = np.floor((points - self.origin_mm) / self.voxel_mm).astype(np.int64)
        i, j, k = np.clip(cell, 0, last).T
        return np.asarray(self.fractions[i, j, k])

    def void_share(self, points: FloatArray) -> float:
        """Share of points (n, 3) in voxels that are less than half full."""
        last = np.array(self.fractions.shape[:3]) - 1
        cell = np.floor((points - self.origin_mm) / self.voxel_mm).astype(np.int64)
        inside = ((cell >= 0) & (cell <= last)).all(axis=1)
        i, j, k = np.clip(cell, 0, last).T
        return float(((self.filled_share[i, j, k] < 0.5) | ~inside).mean())


    def moved(self, part_offset_mm: tuple[float, float, float]) -> AsBuiltComposition:
        """In the coordinates of a part whose origin is at machine coordinates part_offset_mm."""
        return replace(self, origin_mm=self.origin_mm - np.asarray(part_offset_mm))


def read_as_built(path: Path, materials: tuple[str, ...]) -> AsBuiltComposition:
    """Read a voxel map as a composition, in machine coordinates.

    materials : of the part, in order; other materials in the map, the plate, are left out

    Raises InputError where the file is no voxel map, or lacks a material of the part.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["format"]) != _FORMAT:
                raise InputError(f"{path} is a voxel map of another kind",
                                 where=f"{str(file['format'])[:60]!r}, not {_FORMAT!r}",
                                 hint="simulate the part again: the simulated run writes the map")
            powders = [str(name) for name in file["powders"]]
            origin = np.asarray(file["origin_mm"], dtype=np.float64)
            voxel = np.asarray(file["voxel_mm"], dtype=np.float64)
            volumes = np.asarray(file["deposited_mm3"], dtype=np.float64)
    except (KeyError, ValueError, OSError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is no voxel map", where=str(error)[:200],
                         hint="a simulated run on a bench with a table [process] leaves "
                         "voxel-map.npz in its folder") from None
    missing = [name for name in materials if name not in powders]
    if missing:
        raise InputError(f"nothing of {', '.join(missing)} was built",
                         where=f"the map has {', '.join(powders)}", hint="is it of this part?")
    own = np.moveaxis(volumes[[powders.index(name) for name in materials]], 0, 3)
    total = own.sum(axis=3)
    empty = total <= 0
    if empty.all():
        raise InputError(f"{path} has no deposit in it",
                         hint="name the map of a run that deposited something")
    share = own / np.where(empty, 1.0, total)[..., None]
    if empty.any():
        nearest = distance_transform_edt(empty, sampling=voxel, return_distances=False,
                                         return_indices=True)
        share = share[tuple(nearest)]
    return AsBuiltComposition(origin, voxel, share,
                              total / float(np.prod(voxel)))
