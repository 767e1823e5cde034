"""A point cloud made fit to be measured: checked, cleaned, and each sample's neighbourhood known.

What the data cannot bear is refused here, in the reader's terms, before any field is made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.errors import InputError
from lmctl.field.grid import Grid

FloatArray = NDArray[np.float64]

NEIGHBOURS = 24
FEWEST = 64  # below this a closed surface is a guess
ISOLATED = 4.0  # times as far from its sixth neighbour as its surroundings are from theirs
LARGEST_SHARE_DROPPED = 0.02
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
    distinct = np.unique(points, axis=0)
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
    spacing, neighbours = _neighbourhoods(distinct)
    isolated = spacing > ISOLATED * np.median(spacing[neighbours], axis=1)
    if isolated.mean() <= LARGEST_SHARE_DROPPED and isolated.any():
        remarks.append(f"{int(isolated.sum())} points far from all others were dropped as outliers")
        distinct = distinct[~isolated]
        spacing, neighbours = _neighbourhoods(distinct)
    _refuse_sparse(spacing, grid, where)
    _refuse_outside(distinct, grid, where)
    return Samples(distinct, neighbours, spacing, tuple(remarks))


def _neighbourhoods(points: FloatArray) -> tuple[FloatArray, NDArray[np.int32]]:
    """Spacing from the distance that holds six neighbours: π d² / 6 of surface each."""
    distances, rows = cKDTree(points).query(points, k=NEIGHBOURS + 1)
    return distances[:, 6] * np.sqrt(np.pi / 6.0), rows[:, 1:].astype(np.int32)


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
