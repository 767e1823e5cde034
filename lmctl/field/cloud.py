"""Signed distance field of an unorganised point cloud, without normals."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.field import Field
from lmctl.field.grid import Grid
from lmctl.field.outside import Orientation, nearest_samples, orient
from lmctl.field.patches import fit_patches
from lmctl.field.samples import clean_samples
from lmctl.field.sheets import BAND_PITCHES, seed_sheets
from lmctl.field.sweep import sweep_sources

FloatArray = NDArray[np.float64]

REACH_SPACINGS = 1.7  # a patch speaks for the surface this far from its sample


def cloud_field(points: FloatArray, grid: Grid) -> Field:
    """Signed distance to the surface a cloud samples, at the nodes of a grid that holds it.

    Nodes near the cloud measure to a locally fitted surface, not to the nearest sample; closest
    points are swept from there. The outside is let in from the box's faces (`outside.orient`);
    nearer to the samples each node is on the side of the surface its closest point shows it, so
    that a gap in the data is closed where the two sides meet and nothing leaks through it.

    points : (n, 3) float64 [mm], no order, no normals
    returns : Field with sources; its remarks say what was dropped
    raises : InputError for a cloud that is broken, too sparse for the pitch, open, or flat
    """
    samples = clean_samples(points, grid)
    patches = fit_patches(samples)
    orientation = orient(samples, patches, grid.pitch_mm)
    reach = REACH_SPACINGS * samples.spacing_mm + BAND_PITCHES * grid.pitch_mm
    sources = nearest_samples(samples.points_mm, reach, grid)
    surface_mm, inner = seed_sheets(sources, samples, patches, orientation.inward, grid)
    values = sweep_sources(sources, surface_mm, grid)
    _negate_outside(values, sources, surface_mm, inner, orientation, grid)
    if not (values > 0.0).any():
        raise InputError(
            "the point cloud encloses nothing that the grid can see",
            where=f"{len(samples.points_mm)} samples, grid pitch {grid.pitch_mm:g} mm",
            hint="use a smaller pitch",
        )
    return Field(grid, values, sources, surface_mm, samples.remarks + orientation.remarks)


def _negate_outside(
    values: NDArray[np.float32], sources: NDArray[np.int32], surface_mm: FloatArray,
    inner: FloatArray, orientation: Orientation, grid: Grid,
) -> None:
    origin, coarse = np.asarray(grid.origin_mm), orientation.deep_grid
    relative = np.ascontiguousarray((surface_mm - origin) / grid.pitch_mm)
    # The deep node nearest to a node n lies at rint(shift + ratio · n).
    ratio = grid.pitch_mm / coarse.pitch_mm
    shift = (origin - np.asarray(coarse.origin_mm)) / coarse.pitch_mm
    _sign_kernel(values, sources, relative, inner, orientation.deep, shift, ratio)


@njit(cache=True)
def _sign_kernel(
    values: NDArray[np.float32], sources: NDArray[np.int32], points: FloatArray,
    inner: FloatArray, deep: NDArray[np.int8], shift: FloatArray, ratio: float,
) -> None:
    """By the tags where they are sure, else by the pseudonormal of the closest point
    (Bærentzen & Aanæs 2005, doi:10.1109/TVCG.2005.49)."""
    nz, ny, nx = sources.shape
    for k in range(nz):
        kd = min(max(int(np.rint(shift[2] + ratio * k)), 0), deep.shape[0] - 1)
        for j in range(ny):
            jd = min(max(int(np.rint(shift[1] + ratio * j)), 0), deep.shape[1] - 1)
            for i in range(nx):
                i_deep = min(max(int(np.rint(shift[0] + ratio * i)), 0), deep.shape[2] - 1)
                side = deep[kd, jd, i_deep]
                if side == 0:
                    n = sources[k, j, i]
                    along = (
                        (i - points[n, 0]) * inner[n, 0] + (j - points[n, 1]) * inner[n, 1]
                        + (k - points[n, 2]) * inner[n, 2]
                    )
                    side = 1 if along > 0.0 else -1
                if side < 0:
                    values[k, j, i] = -values[k, j, i]
