"""Signed distance field of an unorganised point cloud, without normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.cloud_seeds import BAND_PITCHES, CloudSeeds, seed_cloud
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
PROBE_PITCHES = 2.0
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
    seeds = seed_cloud(owner, samples, sheets, grid)
    del owner
    if not seeds.supported.any():
        raise _nothing_inside(len(samples.points_mm), grid)
    sources, values = _swept(seeds, seeds.supported, grid)
    tags = _tags(values, orientation, seeds, grid)
    good = _on_the_surface(tags, seeds, grid)
    if not np.array_equal(good, seeds.supported):
        sources, values = _swept(seeds, good, grid)
    sure = good & (np.abs(seeds.distance_mm) <= SURE_PITCHES * grid.pitch_mm)
    tags.reshape(-1)[seeds.nodes[sure]] = np.where(seeds.distance_mm[sure] > 0.0, 1, -1)
    if not (tags > 0).any():
        raise _nothing_inside(len(samples.points_mm), grid)
    values *= tags
    return Field(grid, values, sources, seeds.surface_mm, samples.remarks + orientation.remarks)


def _swept(
    seeds: CloudSeeds, used: NDArray[np.bool_], grid: Grid
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    sources = np.full(grid.shape, -1, dtype=np.int32)
    sources.reshape(-1)[seeds.nodes[used]] = np.flatnonzero(used)
    return sources, sweep_sources(sources, seeds.surface_mm, grid)


def _nothing_inside(count: int, grid: Grid) -> InputError:
    return InputError(
        "the point cloud encloses nothing that the grid can see",
        where=f"{count} samples, grid pitch {grid.pitch_mm:g} mm",
        hint="use a smaller pitch",
    )


def _tags(
    values: NDArray[np.float32], orientation: Orientation, seeds: CloudSeeds, grid: Grid
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
    used = np.flatnonzero(seeds.supported)
    used = used[np.argsort(-np.abs(seeds.distance_mm[used]), kind="stable")]
    sides = np.where(seeds.distance_mm[used] > 0.0, 1, -1).astype(np.int8)
    flood(level, tags, seeds.nodes[used], sides)
    return tags


def _on_the_surface(
    tags: NDArray[np.int8], seeds: CloudSeeds, grid: Grid
) -> NDArray[np.bool_]:
    """Which seeds measure to the surface, now that the sides of nodes are known.

    A patch may have reached out into the air, or into the body: supported seeds are then on the
    wrong side, and are left out with their neighbours. Unsupported ones must have the inside on
    one side of their surface point, the outside on the other.
    """
    side = tags.reshape(-1)[seeds.nodes]
    wrong = seeds.supported & (side * seeds.distance_mm < 0.0) & (
        np.abs(seeds.distance_mm) > SURE_PITCHES * grid.pitch_mm
    )
    if wrong.mean() > LARGEST_SHARE_DISPUTED:
        raise InputError(
            "inside and outside of the point cloud cannot be told apart",
            where=f"{100.0 * wrong.mean():.0f} % of the nodes next to the surface are disputed",
            hint="scan more points, or use a larger pitch",
        )
    _, ny, nx = grid.shape
    near_wrong = np.zeros(grid.n_nodes, dtype=np.bool_)
    for dk, dj, di in np.ndindex(3, 3, 3):
        nodes = seeds.nodes[wrong] + ((dk - 1) * ny + (dj - 1)) * nx + (di - 1)
        near_wrong[np.clip(nodes, 0, grid.n_nodes - 1)] = True
    good = ~near_wrong[seeds.nodes]
    rest = np.flatnonzero(~seeds.supported & good)
    inside, outside = (
        _tags_at(tags, seeds.surface_mm[rest] + way * grid.pitch_mm * seeds.inwards[rest], grid)
        for way in (PROBE_PITCHES, -PROBE_PITCHES)
    )
    good[rest] = (inside > 0) & (outside < 0)
    return good


def _tags_at(tags: NDArray[np.int8], points: FloatArray, grid: Grid) -> NDArray[np.int8]:
    node = np.rint((points - np.asarray(grid.origin_mm)) / grid.pitch_mm).astype(np.int64)
    x, y, z = np.clip(node, 0, np.asarray(grid.shape[::-1]) - 1).T
    return np.asarray(tags[z, y, x])
