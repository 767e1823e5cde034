"""Prepare a point cloud for measuring: check it, clean it, find each sample's neighbours.

Unsuitable data is refused here, in the user's terms, before any field is computed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.cloud.neighbour_search import nearest_neighbours, sort_into_cells
from lmctl.field.grid import Grid
from lmctl.field.kernel import kernel

NEIGHBOURS = 24
SPACING_NEIGHBOUR_RANK = 6
MAX_ALIKE_NEIGHBOURS = 16  # as many as a patch is fitted to
# for these, as every other sample may be of the other side of a thin wall
CANDIDATE_NEIGHBOURS = 48
MIN_ALIKE = 8
SAME_FACING_MIN_COSINE = 0.2  # cosine of the angle between normals; less is around an edge
MIN_SAMPLES = 64  # below this a closed surface is a guess
# times as far from its sixth neighbour as its surroundings are from theirs
ISOLATED_SPACING_RATIO = 4.0
MAX_DROPPED_FRACTION = 0.02
#: Sample spacing over the distance d of the sixth neighbour: six samples share π d².
SPACING_PER_SIXTH = float(np.sqrt(np.pi / 6.0))
DENSE_PITCHES = 0.35  # samples nearer to each other than this add nothing on the grid
BLOCK_PITCHES = 8.0
# two places are hardly ever as far along this
OBLIQUE_DIRECTION = np.array([0.5773, 0.6131, 0.5392])
COARSEST_PITCHES = 5.0  # samples typically farther apart than this leave details to guesswork


@dataclass(frozen=True)
class CloudSamples:
    """Distinct samples of one surface.

    points_mm : (n, 3) float64
    neighbours : (n, NEIGHBOURS) int32, the nearest other samples, nearest first
    alike : (n, ≥ 16) int32, those whose normals are not turned away from its own; the same as
        `neighbours` without normals
    spacing_mm : (n,) float64, side of the square of surface each sample represents
    remarks : what was dropped
    normals : (n, 3) float64, of length 1, 0 where not known, pointing outwards if the file is
        right; or None
    """

    points_mm: FloatArray
    neighbours: NDArray[np.int32]
    alike: NDArray[np.int32]
    spacing_mm: FloatArray
    remarks: tuple[str, ...]
    normals: FloatArray | None = None

    @property
    def typical_spacing_mm(self) -> float:
        return float(np.median(self.spacing_mm))


def clean_samples(
    points: FloatArray, grid: Grid, normals: FloatArray | None = None
) -> CloudSamples:
    """Check a cloud and find every sample's neighbours.

    points : (n, 3) float64 [mm]; normals : (n, 3) float64 as they were given, or None
    raises : InputError where coordinates are not numbers, too few points are distinct, all lie
        in one plane, the cloud leaves the grid, or is too sparse for the grid's pitch
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError("the point cloud is not a list of x, y, z",
                         hint="export points as rows of x, y and z")
    where = f"{len(points)} points"
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(
            "the point cloud has coordinates that are not numbers",
            where=(where, f"{len(bad)} points, the first is number {bad[0] + 1}"),
            hint="remove those lines from the file",
        )
    rows = _distinct(points)
    rows = rows[_by_blocks(points[rows], BLOCK_PITCHES * grid.pitch_mm)]
    distinct, facing = points[rows], None if normals is None else unit_or_zero(normals[rows])
    remarks = []
    if len(distinct) < len(points):
        repeated = len(points) - len(distinct)
        remarks.append(f"{repeated} repeated points of the cloud are counted once")
    if len(distinct) < MIN_SAMPLES:
        raise InputError(
            f"the point cloud has only {len(distinct)} distinct points", where=where,
            hint=f"a closed surface needs at least {MIN_SAMPLES}, evenly spread",
        )
    _refuse_flat(distinct, where)
    _refuse_outside(distinct, grid, where)
    if _typical_spacing(distinct) < DENSE_PITCHES * grid.pitch_mm:
        distinct, facing = thin_to_cells(distinct, 0.5 * grid.pitch_mm, facing)
        remarks.append(f"samples denser than the grid were averaged to {len(distinct)} points")
    samples = _with_neighbours(distinct, facing, ())
    isolated = _isolated(samples.spacing_mm, samples.neighbours)
    if isolated.mean() <= MAX_DROPPED_FRACTION and isolated.any():
        remarks.append(f"{int(isolated.sum())} points far from all others were dropped as outliers")
        facing = None if facing is None else facing[~isolated]
        samples = _with_neighbours(distinct[~isolated], facing, ())
    _refuse_sparse(samples.spacing_mm, grid, where)
    return replace(samples, remarks=tuple(remarks))


def _distinct(points: FloatArray) -> IntArray:
    """Rows of each place once, in order of place, so that the order in the file does not matter."""
    along = points @ OBLIQUE_DIRECTION
    order = np.argsort(along, kind="stable")
    new = _differ(points[order])
    if (new[1:] & (np.diff(along[order]) == 0.0)).any():  # different places, as far along
        order = np.lexsort(points.T)
        new = _differ(points[order])
    return order[new]


def _differ(ordered: FloatArray) -> NDArray[np.bool_]:
    new = np.ones(len(ordered), dtype=np.bool_)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    return new


def _by_blocks(points: FloatArray, side_mm: float) -> IntArray:
    """Neighbours near each other in memory, too: block by block, within one as they were."""
    if len(points) == 0:
        return np.zeros(0, dtype=np.int64)
    block = np.floor((points - points.min(axis=0)) / side_mm)
    size = block.max(axis=0) + 1.0
    number = (block[:, 2] * size[1] + block[:, 1]) * size[0] + block[:, 0]
    few = np.prod(size) < np.iinfo(np.uint16).max  # short numbers are sorted many times faster
    return np.argsort(number.astype(np.uint16) if few else number, kind="stable")


def _isolated(spacing: FloatArray, neighbours: NDArray[np.int32]) -> NDArray[np.bool_]:
    neighbour_spacing = spacing[neighbours]
    isolated: NDArray[np.bool_] = spacing > ISOLATED_SPACING_RATIO * neighbour_spacing.min(axis=1)
    isolated[isolated] = spacing[isolated] > ISOLATED_SPACING_RATIO * np.median(
        neighbour_spacing[isolated], axis=1)
    return isolated


def average_in_cells(samples: CloudSamples, cell_mm: float) -> CloudSamples:
    """The samples averaged in cells of a side; where the cloud is sparser it stays as it is."""
    points, normals = thin_to_cells(samples.points_mm, cell_mm, samples.normals)
    return _with_neighbours(points, normals, samples.remarks)


def thin_to_cells(
    points: FloatArray, cell_mm: float, normals: FloatArray | None = None
) -> tuple[FloatArray, FloatArray | None]:
    """The mean of the points in each occupied cell of a side, in order of place, and of normals.

    Points whose normals point along different axes, or opposite ways, stay apart.
    """
    place = np.floor((points - points.min(axis=0)) / cell_mm).astype(np.int64)
    size = place.max(axis=0) + 1
    cell = (place[:, 2] * size[1] + place[:, 1]) * size[0] + place[:, 0]
    if normals is not None:
        axis = np.argmax(np.abs(normals), axis=1)
        cell = 6 * cell + 2 * axis + (normals[np.arange(len(normals)), axis] > 0.0)
    _, member, count = np.unique(cell, return_inverse=True, return_counts=True)

    def mean(values: FloatArray) -> FloatArray:
        return np.stack([np.bincount(member, values[:, a]) / count for a in range(3)], axis=1)

    return mean(points), None if normals is None else unit_or_zero(mean(normals))


def unit_or_zero(normals: FloatArray) -> FloatArray:
    """Rows (n, 3) at length 1; those that are no direction 0."""
    normals = np.asarray(normals, dtype=np.float64)
    size = np.linalg.norm(np.where(np.isfinite(normals), normals, 0.0), axis=1)
    good = np.isfinite(normals).all(axis=1) & (size > 0.0) & np.isfinite(size)
    unit: FloatArray = np.where(good[:, None], normals / np.where(good, size, 1.0)[:, None], 0.0)
    return unit


def _typical_spacing(points: FloatArray) -> float:
    """From a few hundred samples spread through the cloud's order."""
    some = np.arange(0, len(points), max(1, len(points) // 500))
    found = nearest_neighbours(sort_into_cells(points, SPACING_NEIGHBOUR_RANK),
                               SPACING_NEIGHBOUR_RANK, some)[0]
    return float(np.median(found[:, SPACING_NEIGHBOUR_RANK - 1])) * SPACING_PER_SIXTH


def _with_neighbours(
    points: FloatArray, normals: FloatArray | None, remarks: tuple[str, ...]
) -> CloudSamples:
    if len(points) <= NEIGHBOURS:
        raise InputError(
            f"the point cloud has only {len(points)} points apart from each other",
            hint="use a smaller pitch, or check the units",
        )
    if normals is None:
        distances, rows = nearest_neighbours(sort_into_cells(points, NEIGHBOURS), NEIGHBOURS)
        return CloudSamples(points, rows, rows,
                            distances[:, SPACING_NEIGHBOUR_RANK - 1] * SPACING_PER_SIXTH, remarks)
    many = min(CANDIDATE_NEIGHBOURS, len(points) - 1)
    distances, rows = nearest_neighbours(sort_into_cells(points, many), many)
    alike = np.empty((len(points), MAX_ALIKE_NEIGHBOURS), dtype=np.int32)
    spacing = np.empty(len(points))
    _alike_kernel(normals, distances, rows, alike, spacing)
    neighbours = np.ascontiguousarray(rows[:, :NEIGHBOURS])
    return CloudSamples(points, neighbours, alike, spacing * SPACING_PER_SIXTH, remarks, normals)


@kernel
def _alike_kernel(
    normals: FloatArray, distances: FloatArray, rows: NDArray[np.int32], alike: NDArray[np.int32],
    spacing: FloatArray,
) -> None:
    """The first neighbours that face as each point does, and how far the sixth of them is.

    Where too few do, the point's own normal is the odd one: then its nearest, whatever they face.
    """
    most = alike.shape[1]
    for n in range(len(normals)):
        x, y, z = normals[n, 0], normals[n, 1], normals[n, 2]
        for turn in range(2):
            found = 0
            for m in range(rows.shape[1]):
                r = rows[n, m]
                same = x * normals[r, 0] + y * normals[r, 1] + z * normals[r, 2]
                if found < most and (turn == 1 or same > SAME_FACING_MIN_COSINE):
                    alike[n, found] = r
                    found += 1
                    if found == SPACING_NEIGHBOUR_RANK:
                        spacing[n] = distances[n, m]
            if found >= MIN_ALIKE:
                break
        for m in range(found, most):
            alike[n, m] = alike[n, m - found]


def _refuse_flat(points: FloatArray, where: str) -> None:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    if spread[2] < 1e-4 * spread[0]:
        raise InputError(
            "the points of the cloud all lie in one plane" if spread[1] > 1e-4 * spread[0]
            else "the points of the cloud all lie on one line",
            where=where, hint="a part has a surface on every side: scan it from all around",
        )


def _refuse_sparse(spacing: FloatArray, grid: Grid, where: str) -> None:
    typical, widest = float(np.median(spacing)), float(np.quantile(spacing, 0.999))
    if typical > COARSEST_PITCHES * grid.pitch_mm:
        coarser = np.ceil(typical / (COARSEST_PITCHES - 1.0) * 100.0) / 100.0
        raise InputError(
            f"the point cloud is too sparse: samples are up to {widest:.2g} mm apart, "
            f"the grid pitch is {grid.pitch_mm:g} mm",
            where=f"{where}, typically {typical:.2g} mm apart",
            hint=f"use a pitch of at least {coarser:g} mm, or scan more points",
        )


def _refuse_outside(points: FloatArray, grid: Grid, where: str) -> None:
    low = np.asarray(grid.origin_mm)
    high = low + grid.pitch_mm * (np.asarray(grid.shape[::-1]) - 1)
    beyond = int(np.any((points <= low) | (points >= high), axis=1).sum())
    if beyond:
        raise InputError(
            f"{beyond} points of the cloud lie outside its grid", where=where,
            hint="choose the grid around all points of the cloud",
        )
