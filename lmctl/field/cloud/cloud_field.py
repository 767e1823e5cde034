"""Signed distance field of an unorganised point cloud, with normals or without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.cloud.inside_outside import SampleOrientation, orient_samples
from lmctl.field.cloud.local_faces import group_into_faces
from lmctl.field.cloud.neighbour_search import nearest_samples
from lmctl.field.cloud.normals import UnusableNormalsError
from lmctl.field.cloud.patches import FittedPatches
from lmctl.field.cloud.resampling import fit_resampled_patches
from lmctl.field.cloud.samples import CloudSamples, clean_samples
from lmctl.field.cloud.seeds import BAND_PITCHES, CloudSeeds, seed_cloud
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.field.priority_flood import LEVEL_COUNT, flood_tags
from lmctl.field.sweep import propagate_closest_points

REACH_SPACINGS = 2.2  # a patch describes the surface this far from its sample
SURE_PITCHES = 0.5  # nearer to the surface than this, a node's own fit gives its side best
LEVELS_PER_PITCH = 8
PROBE_PITCHES = 2.0
BETWEEN_SPACINGS = 1.1  # with normals there is surface this far around every sample
MAX_DISPUTED_FRACTION = 0.05


def cloud_field(
    points: FloatArray, grid: Grid, normals: FloatArray | None = None
) -> DistanceField:
    """Signed distance to the surface a cloud samples, at the nodes of a grid that holds it.

    Nodes near the cloud measure to a locally fitted surface, not to the nearest sample; closest
    points are swept from there. The outside advances from the box's faces
    (docs/explanation/multi-colour-distance-field.md, Geometry field): first between samples, which
    separates the air from the depth of the body, then from both of these towards the fitted
    surface. The wider way decides, so neither leaks through a gap.

    points : (n, 3) float64 [mm], in no order
    normals : (n, 3) float64, pointing outwards as given in the file; 0 or nan where not given.
        They separate walls thinner than the samples' spacing. They are checked: if all point
        inwards they are turned, if they are inconsistent they are not used; a remark reports both
    returns : Field with sources; its remarks list what was dropped
    raises : InputError for a cloud that is broken, too sparse for the pitch, open, or flat
    """
    samples, patches, orientation = _oriented(points, grid, normals)
    sheets = group_into_faces(samples, patches, orientation.inward_sign, grid)
    reach = np.hypot(REACH_SPACINGS * samples.spacing_mm, BAND_PITCHES * grid.pitch_mm)
    owner = nearest_samples(samples.points_mm, reach, grid)
    seeds = seed_cloud(owner, samples, sheets, grid)
    if not seeds.is_supported.any():
        raise _nothing_inside(len(samples.points_mm), grid)
    supported = seeds.is_supported  # seeds that may be in the air must not block the way
    if samples.normals is not None:
        rows = owner.reshape(-1)[seeds.nodes]
        off = np.linalg.norm(seeds.surface_mm - samples.points_mm[rows], axis=1)
        supported = supported | (off < BETWEEN_SPACINGS * samples.spacing_mm[rows])
    tags = _tags(orientation, seeds, grid, supported)
    good = _on_the_surface(tags, seeds, grid)
    sources = owner  # reuse its memory
    sources.fill(-1)
    sources.reshape(-1)[seeds.nodes[good]] = np.flatnonzero(good)
    values = propagate_closest_points(sources, seeds.surface_mm, grid)
    tags.reshape(-1)[seeds.nodes[good]] = np.where(seeds.distance_mm[good] > 0.0, 1, -1)
    if not (tags > 0).any():
        raise _nothing_inside(len(samples.points_mm), grid)
    values *= tags
    return DistanceField(
        grid, values, sources, seeds.surface_mm, samples.remarks + orientation.remarks,
        seeds.inwards,
    )


def _oriented(
    points: FloatArray, grid: Grid, normals: FloatArray | None
) -> tuple[CloudSamples, FittedPatches, SampleOrientation]:
    samples, patches = fit_resampled_patches(clean_samples(points, grid, normals), grid.pitch_mm)
    try:
        return samples, patches, orient_samples(samples, patches, grid.pitch_mm)
    except UnusableNormalsError as why:
        samples, patches, orientation = _oriented(points, grid, None)
        said = (str(why), *orientation.remarks)
        return samples, patches, replace(orientation, remarks=said)


def _nothing_inside(count: int, grid: Grid) -> InputError:
    return InputError(
        "the point cloud encloses nothing that the grid can see",
        where=f"{count} samples, grid pitch {grid.pitch_mm:g} mm",
        hint="use a smaller pitch",
    )


def _tags(
    orientation: SampleOrientation, seeds: CloudSeeds, grid: Grid, supported: NDArray[np.bool_]
) -> NDArray[np.int8]:
    """(nz, ny, nx) int8, −1 outside, +1 inside: from what is surely deep, towards the seeds.

    supported : (m,) bool, seeds by a surface that is surely there
    """
    coarse = orientation.side_tag_grid
    nearest = [
        np.clip(
            np.rint((grid.axis_mm(a) - coarse.origin_mm[a]) / coarse.pitch_mm).astype(np.int64),
            0, coarse.shape[2 - a] - 1,
        )
        for a in range(3)
    ]
    tags = orientation.side_tags
    for axis in range(3):
        tags = tags.take(nearest[2 - axis], axis)
    for axis in range(3):
        for end in (0, -1):  # what is beyond the grid is air
            face = np.moveaxis(tags, axis, 0)[end]
            face[face == 0] = -1
    away = np.abs(seeds.distance_mm)
    level = np.full(grid.shape, LEVEL_COUNT - 1, dtype=np.uint8)
    level.reshape(-1)[seeds.nodes[supported]] = (
        away[supported] * (LEVELS_PER_PITCH / grid.pitch_mm)
    ).astype(np.uint8)
    # To a 512th of a level, as short numbers are sorted many times faster.
    narrowness = np.iinfo(np.uint16).max - np.minimum(
        away * (512 * LEVELS_PER_PITCH / grid.pitch_mm), np.iinfo(np.uint16).max
    ).astype(np.uint16)
    widest_first = np.argsort(narrowness, kind="stable")
    sides = np.where(seeds.distance_mm > 0.0, 1, -1).astype(np.int8)
    _spread_kernel(level)
    flood_tags(level, tags, seeds.nodes[widest_first], sides[widest_first])
    return tags


@kernel
def _spread_kernel(level: NDArray[np.uint8]) -> None:
    """How far each node is from those with a low level, in levels, along the grid's axes.

    Works in place, forwards and backwards along each axis in turn; that is enough for distances
    along the axes.
    """
    nz, ny, nx = level.shape
    for k in range(nz):
        for j in range(ny):
            least = LEVEL_COUNT
            for i in range(nx):
                least = min(least + LEVELS_PER_PITCH, int(np.int64(level[k, j, i])))
                level[k, j, i] = least
            for i in range(nx - 1, -1, -1):
                least = min(least + LEVELS_PER_PITCH, int(np.int64(level[k, j, i])))
                level[k, j, i] = least
        for j in range(1, ny):
            _nearer_kernel(level[k, j - 1], level[k, j])
        for j in range(ny - 2, -1, -1):
            _nearer_kernel(level[k, j + 1], level[k, j])
        if k > 0:
            for j in range(ny):
                _nearer_kernel(level[k - 1, j], level[k, j])
    for k in range(nz - 2, -1, -1):
        for j in range(ny):
            _nearer_kernel(level[k + 1, j], level[k, j])


@inner_kernel
def _nearer_kernel(before: NDArray[np.uint8], row: NDArray[np.uint8]) -> None:
    for i in range(len(row)):
        row[i] = min(row[i], np.uint8(before[i] + np.uint8(LEVELS_PER_PITCH)))


def _on_the_surface(
    tags: NDArray[np.int8], seeds: CloudSeeds, grid: Grid
) -> NDArray[np.bool_]:
    """Which seeds measure to the surface, now that the sides of nodes are known.

    A patch may extend into the air or into the body. This is possible where no sample supports
    the seed, or where its side or a neighbour's differs from the flood's. Such a seed must have
    the inside on one side of its surface point and the outside on the other.
    """
    side = tags.reshape(-1)[seeds.nodes]
    wrong = seeds.is_supported & (side * seeds.distance_mm < 0.0) & (
        np.abs(seeds.distance_mm) > SURE_PITCHES * grid.pitch_mm
    )
    if wrong.mean() > MAX_DISPUTED_FRACTION:
        raise InputError(
            "inside and outside of the point cloud cannot be distinguished",
            where=f"{100.0 * wrong.mean():.0f} % of the nodes next to the surface are disputed",
            hint="scan more points, or use a larger pitch",
        )
    _, ny, nx = grid.shape
    near_wrong = np.zeros(grid.n_nodes, dtype=np.bool_)
    for dk, dj, di in np.ndindex(3, 3, 3):
        nodes = seeds.nodes[wrong] + ((dk - 1) * ny + (dj - 1)) * nx + (di - 1)
        near_wrong[np.clip(nodes, 0, grid.n_nodes - 1)] = True
    good = seeds.is_supported & ~near_wrong[seeds.nodes]
    rest = np.flatnonzero(~good)
    inside, outside = (
        _tags_at(tags, seeds.surface_mm[rest] + probe * grid.pitch_mm * seeds.inwards[rest], grid)
        for probe in (PROBE_PITCHES, -PROBE_PITCHES)
    )
    good[rest] = (inside > 0) & (outside < 0)
    return good


def _tags_at(tags: NDArray[np.int8], points: FloatArray, grid: Grid) -> NDArray[np.int8]:
    node = np.rint((points - np.asarray(grid.origin_mm)) / grid.pitch_mm).astype(np.int64)
    x, y, z = np.clip(node, 0, np.asarray(grid.shape[::-1]) - 1).T
    return np.asarray(tags[z, y, x])
