"""A point cloud made fit to be measured: checked, cleaned, and each sample's neighbourhood known.

What the data cannot bear is refused here, in the reader's terms, before any field is made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.nearest import Cells, into_cells, nearest_neighbours

FloatArray = NDArray[np.float64]

NEIGHBOURS = 24
FEWEST = 64  # below this a closed surface is a guess
ISOLATED = 4.0  # times as far from its sixth neighbour as its surroundings are from theirs
LARGEST_SHARE_DROPPED = 0.02
SPACING_OF_SIXTH = float(np.sqrt(np.pi / 6.0))  # within that distance d lie six: π d² / 6 for each
DENSE_PITCHES = 0.35  # samples nearer to each other than this tell the grid nothing more
BLOCK_PITCHES = 8.0
ASLANT = np.array([0.5773, 0.6131, 0.5392])  # two places are hardly ever as far along this
COARSEST_PITCHES = 5.0  # samples typically farther apart than this leave details to guesswork


@dataclass(frozen=True)
class Samples:
    """Distinct samples of one surface.

    points_mm : (n, 3) float64
    neighbours : (n, NEIGHBOURS) int32, the nearest other samples, nearest first
    spacing_mm : (n,) float64, side of the square of surface each sample stands for
    remarks : what was dropped
    """

    points_mm: FloatArray
    neighbours: NDArray[np.int32]
    spacing_mm: FloatArray
    remarks: tuple[str, ...]

    @property
    def typical_spacing_mm(self) -> float:
        return float(np.median(self.spacing_mm))


def clean_samples(points: FloatArray, grid: Grid) -> Samples:
    """Check a cloud and find every sample's neighbours.

    points : (n, 3) float64 [mm]
    raises : InputError where coordinates are not numbers, too few points are distinct, all lie
        in one plane, the cloud leaves the grid, or is too sparse for the grid's pitch
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError("the point cloud is not a list of x, y, z")
    where = f"{len(points)} points"
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(
            "the point cloud has coordinates that are not numbers",
            where=(where, f"{len(bad)} points, the first is number {bad[0] + 1}"),
            hint="remove those lines from the file",
        )
    distinct = _by_blocks(_distinct(points), BLOCK_PITCHES * grid.pitch_mm)
    remarks = []
    if len(distinct) < len(points):
        repeated = len(points) - len(distinct)
        remarks.append(f"{repeated} repeated points of the cloud are counted once")
    if len(distinct) < FEWEST:
        raise InputError(
            f"the point cloud has only {len(distinct)} distinct points", where=where,
            hint=f"a closed surface needs at least {FEWEST}, evenly spread",
        )
    _refuse_flat(distinct, where)
    _refuse_outside(distinct, grid, where)
    cells = into_cells(distinct)
    if _typical_spacing(cells) < DENSE_PITCHES * grid.pitch_mm:
        distinct = thinned(distinct, 0.5 * grid.pitch_mm)
        remarks.append(f"samples denser than the grid were averaged to {len(distinct)} points")
        cells = into_cells(distinct)
    spacing, neighbours = _neighbourhoods(cells)
    isolated = _isolated(spacing, neighbours)
    if isolated.mean() <= LARGEST_SHARE_DROPPED and isolated.any():
        remarks.append(f"{int(isolated.sum())} points far from all others were dropped as outliers")
        distinct = distinct[~isolated]
        spacing, neighbours = _neighbourhoods(into_cells(distinct))
    _refuse_sparse(spacing, grid, where)
    return Samples(distinct, neighbours, spacing, tuple(remarks))


def _distinct(points: FloatArray) -> FloatArray:
    """Each place once, in order of place, so that the order in the file does not matter."""
    along = points @ ASLANT
    order = np.argsort(along)
    ordered = points[order]
    new = np.ones(len(ordered), dtype=np.bool_)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    if (new[1:] & (np.diff(along[order]) == 0.0)).any():  # different places, as far along
        ordered = points[np.lexsort(points.T)]
        new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    return ordered[new]


def _by_blocks(points: FloatArray, side_mm: float) -> FloatArray:
    """Neighbours near each other in memory, too: block by block, within one as they were."""
    if len(points) == 0:
        return points
    block = np.floor((points - points.min(axis=0)) / side_mm)
    size = block.max(axis=0) + 1.0
    number = (block[:, 2] * size[1] + block[:, 1]) * size[0] + block[:, 0]
    few = np.prod(size) < np.iinfo(np.uint16).max  # short numbers are sorted many times faster
    ordered: FloatArray = points[
        np.argsort(number.astype(np.uint16) if few else number, kind="stable")
    ]
    return ordered


def _isolated(spacing: FloatArray, neighbours: NDArray[np.int32]) -> NDArray[np.bool_]:
    theirs = spacing[neighbours]
    isolated: NDArray[np.bool_] = spacing > ISOLATED * theirs.min(axis=1)
    isolated[isolated] = spacing[isolated] > ISOLATED * np.median(theirs[isolated], axis=1)
    return isolated


def averaged(samples: Samples, cell_mm: float) -> Samples:
    """The samples averaged in cells of a side; where the cloud is sparser it stays as it is."""
    points = thinned(samples.points_mm, cell_mm)
    spacing, neighbours = _neighbourhoods(into_cells(points))
    return Samples(points, neighbours, spacing, samples.remarks)


def thinned(points: FloatArray, cell_mm: float) -> FloatArray:
    """The mean of the points in each occupied cell of a side, in order of place."""
    place = np.floor((points - points.min(axis=0)) / cell_mm).astype(np.int64)
    size = place.max(axis=0) + 1
    cell = (place[:, 2] * size[1] + place[:, 1]) * size[0] + place[:, 0]
    _, member, count = np.unique(cell, return_inverse=True, return_counts=True)
    return np.stack([np.bincount(member, points[:, a]) / count for a in range(3)], axis=1)


def _typical_spacing(cells: Cells) -> float:
    """From a few hundred samples spread through the cloud's order."""
    some = np.arange(0, len(cells.points), max(1, len(cells.points) // 500))
    return float(np.median(nearest_neighbours(cells, 6, some)[0][:, 5])) * SPACING_OF_SIXTH


def _neighbourhoods(cells: Cells) -> tuple[FloatArray, NDArray[np.int32]]:
    distances, rows = nearest_neighbours(cells, NEIGHBOURS)
    return distances[:, 5] * SPACING_OF_SIXTH, rows


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
