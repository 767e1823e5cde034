"""Gaps between flat faces of two shells that were meant to be flush, closed.

Assemblies exported block by block meet but for rounding. Where two flat faces face each other at a
distance that no nozzle can leave open, one of them is moved onto the other and 1e-5 mm into it. The
union of the solids then finds an overlap, not a contact that depends on rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray

#: How far a face is moved into the other [mm].
OVERLAP_MM = 1e-5

#: Planes whose normals and offsets differ by less are one plane.
SAME_NORMAL, SAME_MM = 1e-5, 1e-4


@dataclass(frozen=True)
class ClosedGap:
    """A gap that was closed: how wide, and where."""

    width_mm: float
    place_mm: FloatArray


@dataclass(frozen=True, eq=False)
class _Faces:
    """Triangles of a shell: corners (m, 3, 3), unit normals (m, 3), offsets along them (m,)."""

    rows: IntArray
    corners: FloatArray
    normals: FloatArray
    offsets: FloatArray


def close_gap(
    moved: FloatArray, triangles: IntArray, vertices: FloatArray, others: IntArray, gap_mm: float
) -> list[ClosedGap]:
    """Move flat faces of one shell onto those of another that they face, in place.

    moved, triangles : corners (n, 3) and triangles (m, 3) of the one, facing out
    vertices, others : of the other
    gap_mm : gaps up to this wide are closed
    """
    box = np.stack([vertices.min(axis=0), vertices.max(axis=0)])
    own_box = np.stack([moved.min(axis=0), moved.max(axis=0)])
    own = _faces(moved, triangles, box, gap_mm)
    facing = _faces(vertices, others, own_box, gap_mm)
    if len(own.rows) == 0 or len(facing.rows) == 0:
        return []
    from scipy.spatial import cKDTree  # late: scipy takes as long to load as a small part

    size = max(1.0, float(np.ptp(own_box, axis=0).max()))
    ahead = np.column_stack([own.normals * size, own.offsets])
    behind = np.column_stack([-facing.normals * size, -facing.offsets])
    gaps: list[ClosedGap] = []
    left = np.ones(len(own.rows), dtype=bool)
    pairs = cKDTree(ahead).query_ball_tree(cKDTree(behind), gap_mm + SAME_MM)
    for number, found in enumerate(pairs):
        if not left[number] or not found:
            continue
        normal, offset = own.normals[number], own.offsets[number]
        patch = left & _of_plane(own, normal, offset)
        width = -facing.offsets[found] - offset
        close = np.asarray(found)[(width >= -SAME_MM) & (width <= gap_mm)]
        if len(close) == 0:
            continue
        nearest = int(close[np.argmin(-facing.offsets[close])])
        wall = _of_plane(facing, facing.normals[nearest], facing.offsets[nearest])
        left &= ~patch
        gap = float(-facing.offsets[nearest] - offset)
        if _is_flush(normal, gap) or not _overlap(own.corners[patch], facing.corners[wall], normal):
            continue
        moved[np.unique(triangles[own.rows[patch]])] += (max(gap, 0.0) + OVERLAP_MM) * normal
        gaps.append(ClosedGap(gap, own.corners[patch].reshape(-1, 3).mean(axis=0)))
    return gaps


def _faces(vertices: FloatArray, triangles: IntArray, box: FloatArray, gap_mm: float) -> _Faces:
    """The triangles that come near a box."""
    corners = vertices[triangles]
    near = np.all((corners.min(axis=1) <= box[1] + gap_mm)
                  & (corners.max(axis=1) >= box[0] - gap_mm), axis=1)
    rows = np.flatnonzero(near)
    corners = corners[rows]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    wide = size > 0.0
    rows, corners = rows[wide], corners[wide]
    normal = normal[wide] / size[wide, None]
    return _Faces(rows, corners, normal, (corners.mean(axis=1) * normal).sum(axis=1))


def _of_plane(faces: _Faces, normal: FloatArray, offset: float) -> NDArray[np.bool_]:
    same: NDArray[np.bool_] = (np.abs(faces.normals - normal).max(axis=1) < SAME_NORMAL) & (
        np.abs(faces.offsets - offset) < SAME_MM)
    return same


def _is_flush(normal: FloatArray, gap: float) -> bool:
    """Whether two faces across an axis are at the very same coordinate."""
    return gap == 0.0 and bool(np.count_nonzero(normal) == 1)


def _overlap(one: FloatArray, other: FloatArray, normal: FloatArray) -> bool:
    """Whether triangles (m, 3, 3) of two parallel planes cover each other anywhere."""
    from manifold3d import CrossSection, FillRule  # only few meshes need it

    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(normal, across)], axis=1)
    flat = [CrossSection(list(corners @ axes), FillRule.NonZero) for corners in (one, other)]
    return bool((flat[0] ^ flat[1]).area() > 0.0)
