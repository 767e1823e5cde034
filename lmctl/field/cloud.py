"""Signed distance field of an unorganised point cloud, without normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.cloud_seeds import BAND_PITCHES, seed_cloud
from lmctl.field.field import Field
from lmctl.field.flood import LEVELS, flood
from lmctl.field.grid import Grid
from lmctl.field.outside import Orientation, nearest_samples, orient
from lmctl.field.patches import fit_patches
from lmctl.field.samples import clean_samples
from lmctl.field.sheets import sort_sheets
from lmctl.field.sweep import sweep_sources

FloatArray = NDArray[np.float64]

REACH_SPACINGS = 2.2  # a patch speaks for the surface this far from its sample
SURE_PITCHES = 0.5  # nearer to the surface than this a node's own fit knows its side best
LEVELS_PER_PITCH = 8
LARGEST_SHARE_DISPUTED = 0.05


def cloud_field(points: FloatArray, grid: Grid) -> Field:
    """Signed distance to the surface a cloud samples, at the nodes of a grid that holds it.

    Nodes near the cloud measure to a locally fitted surface, not to the nearest sample; closest
    points are swept from there. The outside is let in from the box's faces (method.md 1): first
    between samples, which tells the air from the depth of the body, then from both of these
    towards the fitted surface. The wider way decides, so neither leaks through a gap.

    points : (n, 3) float64 [mm], no order, no normals
    returns : Field with sources; its remarks say what was dropped
    raises : InputError for a cloud that is broken, too sparse for the pitch, open, or flat
    """
    samples = clean_samples(points, grid)
    patches = fit_patches(samples)
    orientation = orient(samples, patches, grid.pitch_mm)
    sheets = sort_sheets(samples, patches, orientation.inward, grid)
    reach = REACH_SPACINGS * samples.spacing_mm + BAND_PITCHES * grid.pitch_mm
    owner = nearest_samples(samples.points_mm, reach, grid)
    sources, surface_mm, signed = seed_cloud(owner, samples, sheets, grid)
    del owner
    if not len(surface_mm):
        raise _nothing_inside(len(samples.points_mm), grid)
    seeds = np.flatnonzero(sources >= 0)  # the seed of row n is seeds[n]
    values = sweep_sources(sources, surface_mm, grid)
    tags = _tags(values, orientation, seeds, signed, grid)
    disputed = (tags.reshape(-1)[seeds] * signed < 0.0) & (
        np.abs(signed) > SURE_PITCHES * grid.pitch_mm
    )
    if disputed.mean() > LARGEST_SHARE_DISPUTED:
        raise InputError(
            "inside and outside of the point cloud cannot be told apart",
            where=f"{100.0 * disputed.mean():.0f} % of the nodes next to the surface are disputed",
            hint="scan more points, or use a larger pitch",
        )
    if disputed.any():
        # A patch reached out into the air there, or into the body: measure without it.
        rows = np.flatnonzero(~_touching(seeds, disputed, grid))
        sources.fill(-1)
        sources.reshape(-1)[seeds[rows]] = rows
        seeds, signed = seeds[rows], signed[rows]
        values = sweep_sources(sources, surface_mm, grid)
    sure = np.abs(signed) <= SURE_PITCHES * grid.pitch_mm
    tags.reshape(-1)[seeds[sure]] = np.where(signed[sure] > 0.0, 1, -1)
    values *= tags
    if not (tags > 0).any():
        raise _nothing_inside(len(samples.points_mm), grid)
    return Field(grid, values, sources, surface_mm, samples.remarks + orientation.remarks)


def _nothing_inside(count: int, grid: Grid) -> InputError:
    return InputError(
        "the point cloud encloses nothing that the grid can see",
        where=f"{count} samples, grid pitch {grid.pitch_mm:g} mm",
        hint="use a smaller pitch",
    )


def _tags(
    values: NDArray[np.float32], orientation: Orientation, seeds: NDArray[np.int64],
    signed: FloatArray, grid: Grid,
) -> NDArray[np.int8]:
    """(nz, ny, nx) int8, −1 outside, +1 inside: from what is surely deep, towards the seeds."""
    coarse = orientation.deep_grid
    nearest = [
        np.clip(
            np.rint((grid.axis_mm(a) - coarse.origin_mm[a]) / coarse.pitch_mm).astype(np.int64),
            0, coarse.shape[2 - a] - 1,
        )
        for a in range(3)
    ]
    tags = orientation.deep[np.ix_(nearest[2], nearest[1], nearest[0])]
    level = np.minimum(values * (LEVELS_PER_PITCH / grid.pitch_mm), LEVELS - 1).astype(np.uint8)
    widest_first = np.argsort(-np.abs(signed), kind="stable")
    sides = np.where(signed > 0.0, 1, -1).astype(np.int8)
    flood(level, tags, seeds[widest_first], sides[widest_first])
    return tags


def _touching(
    seeds: NDArray[np.int64], disputed: NDArray[np.bool_], grid: Grid
) -> NDArray[np.bool_]:
    """Which seeds are disputed, or next to one that is."""
    _, ny, nx = grid.shape
    touched = np.zeros(grid.n_nodes, dtype=np.bool_)
    for dk, dj, di in np.ndindex(3, 3, 3):
        nodes = seeds[disputed] + ((dk - 1) * ny + (dj - 1)) * nx + (di - 1)
        touched[np.clip(nodes, 0, grid.n_nodes - 1)] = True
    return np.asarray(touched[seeds])
