"""An as-built comparison for ParaView: designed and built, voxel by voxel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lmctl.as_built.comparison import AsBuiltComparison
from lmctl.report.part_export import array_names
from lmctl.report.vti_file import VTI_TAIL, vti_head


def write_as_built_field(found: AsBuiltComparison, target: Path) -> None:
    """Write a VTK image (.vti) of nodes at the voxels' centres, in the part's own coordinates.

    Arrays: distance [mm], filled (share of the voxel), composition_error, and "designed" and
    "built" of each material; NaN where the voxel is not inside the part and filled. Raises OSError.
    """
    nx, ny, nz = found.filled.shape
    names = ["distance", "filled", "composition_error"]
    for material in array_names(found.materials)[1:]:
        names += [f"designed {material}", f"built {material}"]
    head = vti_head((nz, ny, nx), (found.corner_mm + found.voxel_mm / 2).tolist(),
                    found.voxel_mm.tolist(), names)
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as file:
            file.write(head)
            for values in _arrays(found):
                data = np.ascontiguousarray(values.reshape(nx, ny, nz).T, dtype="<f4").tobytes()
                file.write(np.uint64(len(data)).tobytes())
                file.write(data)
            file.write(VTI_TAIL)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _arrays(found: AsBuiltComparison) -> list[NDArray[np.float32]]:
    def spread(values: NDArray[np.float64]) -> NDArray[np.float32]:
        whole = np.full(found.filled.size, np.nan, dtype=np.float32)
        whole[found.rows] = values
        return whole

    arrays = [found.design.distance_mm, found.filled, spread(found.error)]
    for column in range(len(found.materials)):
        arrays += [spread(found.design_fractions[:, column]),
                   spread(found.built_fractions[:, column])]
    return arrays
