"""What was built, as voxels and along the path, simulated or predicted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray

#: Who says what was built: the simulated process, or the model that the profile believes.
BuiltBy = Literal["simulated", "predicted"]


@dataclass(frozen=True)
class BuiltPath:
    """The path with the beam on, in n pieces, in the order in which they were made.

    place_mm : (n, 3) tool point in machine coordinates; beam_on_mm : (n,) length
    delivered : (n, k) volume fractions of what stayed there; NaN where nothing did
    surface_mm : (n,) surface below the piece above the plate, before it was deposited; NaN: unknown
    line : (n,) N word of the program line
    """

    place_mm: FloatArray
    beam_on_mm: FloatArray
    delivered: FloatArray
    surface_mm: FloatArray
    line: IntArray


@dataclass(frozen=True)
class PowderUse:
    """(k,) float64 each [g]: what left the hoppers, and the nozzle with the beam on and off."""

    density_g_mm3: FloatArray
    fed_g: FloatArray
    beam_on_g: FloatArray
    beam_off_g: FloatArray


@dataclass(frozen=True)
class BuiltVolume:
    """Voxels in machine coordinates.

    origin_mm : (3,) lowest corner; voxel_mm : (3,) edges of a voxel
    materials : k names; the last is the plate
    plate_material : of the part's materials, the one that the plate is of; "" for none
    deposited_mm3 : (k, nx, ny, nz) float32, the plate included
    height_mm : (nx, ny) float64, surface above the plate's top
    plate_z_mm : z of the plate's top
    powder : None where it was not weighed
    notes : what went wrong while it was built
    """

    built_by: BuiltBy
    origin_mm: FloatArray
    voxel_mm: FloatArray
    materials: tuple[str, ...]
    plate_material: str
    deposited_mm3: NDArray[np.float32]
    height_mm: FloatArray
    plate_z_mm: float
    path: BuiltPath
    powder: PowderUse | None
    notes: tuple[str, ...]

    @property
    def voxel_volume_mm3(self) -> float:
        return float(self.voxel_mm.prod())

    @property
    def first_plane(self) -> int:
        """Index along z of the first voxels above the plate."""
        return round((self.plate_z_mm - float(self.origin_mm[2])) / float(self.voxel_mm[2]))
