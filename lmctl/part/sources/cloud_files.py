"""Measured points from XYZ, CSV, PTS, ASC and PLY files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.sources.files import CLOUD_SUFFIXES, DataFile
from lmctl.part.sources.mesh_files import checked_points
from lmctl.part.sources.ply_files import read_ply
from lmctl.part.sources.point_tables import NORMAL_NAMES, read_point_table

#: More points than this do not make any field finer, only slower.
MAX_POINTS = 20_000_000

#: Fewer points enclose nothing.
MIN_POINTS = 100

#: At most this share of the points may be outliers that are dropped.
MAX_OUTLIER_FRACTION = 0.005

#: Points, normals or None, notes.
RawCloud = tuple[NDArray[np.float64], NDArray[np.float64] | None, list[str]]


@dataclass(frozen=True)
class PointCloud:
    """points: (n, 3) float64 [mm], in no order; notes: what of the file was left out.

    normals: (n, 3) float64, outwards at each point, if the file gives them; else None
    warnings: what is doubtful about its points
    """

    points: NDArray[np.float64]
    notes: tuple[str, ...]
    normals: NDArray[np.float64] | None = None
    warnings: tuple[str, ...] = ()


def read_cloud(file: DataFile, units: str) -> PointCloud:
    """The points of a cloud file in mm, each place once.

    Raises InputError where it cannot be read (with the line), has too few or too many points,
    coordinates that are not numbers, or a size no part of this machine's kind has.
    """
    if file.suffix == "ply":
        points, normals, notes = _from_ply(file)
    elif file.suffix in CLOUD_SUFFIXES:
        table = read_point_table(file)
        points, normals, notes = table.points, table.normals, list(table.notes)
    else:
        raise InputError(
            f"{file.path} is not a kind of point cloud that can be read",
            hint="XYZ, CSV, TXT, ASC, PTS and PLY files can; the ending must say which it is",
        )
    if not MIN_POINTS <= len(points) <= MAX_POINTS:
        raise InputError(
            f"{file.path} has {len(points):,} points",
            where=f"{MIN_POINTS} to {MAX_POINTS:,} points can be used",
            hint="scan the surface more densely" if len(points) < MIN_POINTS else
            "thin it out: detail far below the bead width is lost anyway",
        )
    warnings = []
    kept = inlier_mask(points)
    if not kept.all():
        outlier = int(np.argmin(kept))
        place = ", ".join(f"{v:.6g}" for v in points[outlier])
        warnings.append(
            f"{file.path.name}: {int((~kept).sum())} of {len(points):,} points lie far from all "
            f"others and were dropped as outliers; the first is point {outlier + 1}, ({place})")
        points, normals = points[kept], None if normals is None else normals[kept]
    points = checked_points(file, points, units, used=None, what="point")
    single, first = np.unique(points, axis=0, return_index=True)
    if len(single) < len(points):
        notes.append(f"{file.path.name}: {len(points) - len(single):,} points are there twice")
    return PointCloud(
        single, tuple(notes), None if normals is None else normals[first], tuple(warnings))


def _from_ply(file: DataFile) -> RawCloud:
    elements = read_ply(file)
    vertex = elements["vertex"].numbers if "vertex" in elements else {}
    if not all(axis in vertex for axis in "xyz") or len(vertex["x"]) == 0:
        raise InputError(f"{file.path} holds no points",
                         where="its head names no rows of an element vertex with x, y and z",
                         hint="export it again")
    points = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    notes = []
    faces = elements.get("face")
    count = max((len(sizes) for sizes, _ in faces.lists.values()), default=0) if faces else 0
    if count:
        notes.append(f"{file.path.name}: its {count:,} faces are not used, as it is given as a "
                     "cloud")
    normals = None
    if all(name in vertex for name in NORMAL_NAMES[0]):
        normals = np.stack([vertex[name] for name in NORMAL_NAMES[0]], axis=1)
        notes.append(f"{file.path.name}: its normals are used")
    return points, normals, notes


def inlier_mask(points: FloatArray) -> NDArray[np.bool_]:
    """Which of points (n, 3) belong to what was scanned, (n,): all but a few outliers.

    An outlier is farther from the box of nearly all points than that box is large. Nearer ones are
    found later, by their distance from the fitted surface.
    """
    finite = np.isfinite(points).all(axis=1)
    kept = np.ones(len(points), dtype=bool)
    if not finite.any():
        return kept
    low, high = np.quantile(points[finite], [MAX_OUTLIER_FRACTION, 1.0 - MAX_OUTLIER_FRACTION],
                            axis=0)
    size = float((high - low).max())
    far = finite & ((points < low - size) | (points > high + size)).any(axis=1)
    return kept if far.mean() > MAX_OUTLIER_FRACTION else ~far
