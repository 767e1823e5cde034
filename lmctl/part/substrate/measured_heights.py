"""The upper side of a surface of triangles, or of measured points, as heights on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.kernel import kernel
from lmctl.field.plane import PlaneGrid
from lmctl.part.substrate.surface_heights import GridHeights

#: A height is fitted to so many of the nearest samples, and counts where the nearest is within so
#: many times their usual spacing or the grid's pitch.
_NEIGHBOURS = 20
_REACH = 2.0
#: Of these, what lies deeper below the second highest than this, and this much for each mm that
#: they reach, belongs to a lower side. The highest alone may be an outlier.
_LOWER_SIDE_MM, _LOWER_SIDE_SLOPE = 0.3, 1.5
#: Samples that are this many times the median residual off their plane count a quarter.
_OUTLIER = 3.0
_SLOPE_DAMPING = 2e-3
_ROUNDS = 4
#: Grids larger than this are coarsened.
_MOST_NODES = 1_000_000


def grid_over(low_mm: FloatArray, high_mm: FloatArray, pitch_mm: float) -> PlaneGrid:
    """Nodes that hold the rectangle from low to high, (2,) each, a node to spare around it."""
    pitch = max(pitch_mm, float(np.sqrt(np.prod(np.maximum(high_mm - low_mm, pitch_mm))
                                        / _MOST_NODES)))
    first = np.floor(low_mm / pitch).astype(int) - 1
    last = np.ceil(high_mm / pitch).astype(int) + 1
    nx, ny = (int(n) for n in last - first + 1)
    return PlaneGrid((float(first[0] * pitch), float(first[1] * pitch)), pitch, (ny, nx))


def heights_of_points(points_mm: FloatArray, grid: PlaneGrid, name: str) -> GridHeights:
    """The upper side of samples (n, 3), by a plane fitted around each node.

    Raises InputError where too few samples lie over the grid.
    """
    from scipy.spatial import cKDTree  # late: takes long to load, and few parts are repairs

    low = np.array(grid.origin_mm)
    high = low + grid.pitch_mm * (np.array(grid.shape[::-1]) - 1)
    over = points_mm[((points_mm[:, :2] >= low) & (points_mm[:, :2] <= high)).all(axis=1)]
    if len(over) < _NEIGHBOURS:
        raise InputError(f"{name} has {len(over)} samples over the part; it needs many more",
                         where=f"x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}",
                         hint="check that it is in the part file's coordinates, and its units")
    tree = cKDTree(over[:, :2])
    spacing = float(np.median(tree.query(over[: 20_000, :2], k=2)[0][:, 1]))
    y, x = np.meshgrid(grid.y_mm, grid.x_mm, indexing="ij")
    places = np.column_stack([x.ravel(), y.ravel()])
    away, near = tree.query(places, k=_NEIGHBOURS)
    heights = _plane_heights(places, over, away, near, max(spacing, 0.5 * grid.pitch_mm))
    covered = away[:, 0] <= _REACH * max(spacing, grid.pitch_mm)
    heights = np.where(covered, heights, over[near[:, 0], 2])
    return GridHeights(grid, heights.reshape(grid.shape), covered.reshape(grid.shape))


def heights_of_mesh(vertices_mm: FloatArray, triangles: IntArray, grid: PlaneGrid) -> GridHeights:
    """The upper side of triangles (m, 3) of vertices (n, 3)."""
    from scipy.ndimage import distance_transform_edt  # late, as above

    values = np.asarray(_highest(
        np.ascontiguousarray(vertices_mm, dtype=np.float64), np.ascontiguousarray(triangles),
        *grid.origin_mm, grid.pitch_mm, *grid.shape))
    covered = np.isfinite(values)
    if not covered.any():
        return GridHeights(grid, np.zeros(grid.shape), covered)
    nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return GridHeights(grid, values[tuple(nearest)], covered)


def _plane_heights(
    places: FloatArray, points: FloatArray, away: FloatArray, near: NDArray[np.intp],
    width_mm: float,
) -> FloatArray:
    """Heights of weighted planes through the neighbours of each place, on the upper side and
    without outliers."""
    d = points[near][:, :, :2] - places[:, None]
    z = points[near][:, :, 2]
    reach = away[:, [-1]]
    upper = z >= np.sort(z, axis=1)[:, [-2]] - _LOWER_SIDE_MM - _LOWER_SIDE_SLOPE * reach
    by_distance = np.exp(-(away / np.maximum(reach / 1.5, width_mm)) ** 2) * upper + 1e-12
    weight = by_distance
    base = np.stack([np.ones_like(z), d[:, :, 0], d[:, :, 1]], axis=2)
    for _ in range(_ROUNDS):
        weighted = base * weight[:, :, None]
        normal = np.einsum("nki,nkj->nij", weighted, base)
        # Where few samples fix a slope it tends to 0.
        scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        normal = normal + scale * np.diag([1e-9, _SLOPE_DAMPING, _SLOPE_DAMPING])
        fit = np.linalg.solve(normal, np.einsum("nki,nk->ni", weighted, z)[:, :, None])[:, :, 0]
        off = np.abs(np.einsum("nki,ni->nk", base, fit) - z)
        usual = np.nanmedian(np.where(upper, off, np.nan), axis=1, keepdims=True)
        weight = by_distance / (1 + (off / (_OUTLIER * usual + 1e-6)) ** 2) ** 2
    return np.asarray(fit[:, 0])


@kernel
def _highest(
    vertices: FloatArray, triangles: IntArray, x0: float, y0: float, pitch: float, ny: int, nx: int
) -> FloatArray:
    """(ny, nx) highest z of the triangles over each node; −inf where there is none."""
    found = np.full((ny, nx), -np.inf)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay = vertices[a, 0] - x0, vertices[a, 1] - y0
        bx, by = vertices[b, 0] - x0, vertices[b, 1] - y0
        cx, cy = vertices[c, 0] - x0, vertices[c, 1] - y0
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        i0 = max(0, int(np.ceil(min(ax, bx, cx) / pitch - 1e-9)))
        i1 = min(nx - 1, int(np.floor(max(ax, bx, cx) / pitch + 1e-9)))
        j0 = max(0, int(np.ceil(min(ay, by, cy) / pitch - 1e-9)))
        j1 = min(ny - 1, int(np.floor(max(ay, by, cy) / pitch + 1e-9)))
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                px, py = i * pitch, j * pitch
                u = ((px - ax) * (cy - ay) - (py - ay) * (cx - ax)) / area
                v = ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) / area
                if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9:
                    z = (vertices[a, 2] + u * (vertices[b, 2] - vertices[a, 2])
                         + v * (vertices[c, 2] - vertices[a, 2]))
                    found[j, i] = max(found[j, i], z)
    return found
