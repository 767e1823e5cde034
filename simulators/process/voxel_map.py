"""What was built, as voxels: volume of each powder, height, and the path that built it.

The file is described in docs/reference/voxel-map.md.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from simulators.array_types import FloatArray

#: Says what the file is; a reader refuses others.
FORMAT = "voxel-map-1"
#: zlib's quickest.
_COMPRESS_LEVEL = 1


@dataclass(frozen=True)
class VoxelMap:
    """The build in machine coordinates.

    origin_mm : (3,) lowest corner of voxel (0, 0, 0); voxel_mm : (3,) edges of a voxel
    powders : k names, the substrate last
    substrate_material : what the plate is of, "" for a material of its own
    deposited_mm3 : (k, nx, ny, nz) float32, of each material in each voxel, the plate included
    height_mm : (nx, ny) of the surface above the plate
    substrate_z_mm : z of the plate's top
    density_g_mm3 : (k,), NaN for the substrate
    fed_g, beam_on_g, beam_off_g : (k,) powder that left the hoppers, and that left the nozzle with
        the beam on and off
    place_mm : (n, 3) tool point at the middle of each piece of the path with the beam on
    time_s, beam_on_mm : (n,) its time and length
    delivered : (n, k) volume fractions of what stayed of the powder; NaN where nothing did
    surface_mm : (n,) height of the surface below the bead, above the plate, before it was deposited
    line : (n,) int32 N word of the program
    notes : for the reader of the file
    """

    origin_mm: FloatArray
    voxel_mm: FloatArray
    powders: tuple[str, ...]
    substrate_material: str
    deposited_mm3: NDArray[np.float32]
    height_mm: FloatArray
    substrate_z_mm: float
    density_g_mm3: FloatArray
    fed_g: FloatArray
    beam_on_g: FloatArray
    beam_off_g: FloatArray
    place_mm: FloatArray
    time_s: FloatArray
    beam_on_mm: FloatArray
    delivered: FloatArray
    surface_mm: FloatArray
    line: NDArray[np.int32]
    notes: tuple[str, ...]

    def write(self, target: Path) -> None:
        """Write the file, whole or not at all. Raises OSError."""
        partial = target.with_name(f".{target.name}.partial")
        try:
            with partial.open("wb") as file:
                _write_arrays(file, {
                    "format": np.str_(FORMAT), "origin_mm": self.origin_mm,
                    "voxel_mm": self.voxel_mm, "powders": np.array(self.powders),
                    "substrate_material": np.str_(self.substrate_material),
                    "deposited_mm3": self.deposited_mm3,
                    "height_mm": self.height_mm.astype(np.float32),
                    "substrate_z_mm": np.float64(self.substrate_z_mm),
                    "density_g_mm3": self.density_g_mm3, "fed_g": self.fed_g,
                    "beam_on_g": self.beam_on_g, "beam_off_g": self.beam_off_g,
                    "place_mm": self.place_mm.astype(np.float32), "time_s": self.time_s,
                    "beam_on_mm": self.beam_on_mm.astype(np.float32),
                    "delivered": self.delivered.astype(np.float32),
                    "surface_mm": self.surface_mm.astype(np.float32), "line": self.line,
                    "notes": np.array(self.notes, dtype=np.str_),
                })
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)


def _write_arrays(file: BinaryIO, arrays: dict[str, Any]) -> None:
    """An .npz archive: compressed quickly, which costs a twentieth of its size, and without the
    time of day, so that equal builds are equal files."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=_COMPRESS_LEVEL) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)
