"""A signed distance stored at the nodes of a grid, and read back between them."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as field_of

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.features import length
from lmctl.field.grid import Grid, Window
from lmctl.field.interpolate import refine_distances
from lmctl.field.kernel import kernel
from lmctl.field.triangles import closest_points_on_rows

ENTRIES_TRIED = 4


@dataclass(frozen=True)
class DistanceField:
    """Signed distance at grid nodes, positive inside.

    values : (nz, ny, nx) float32 [mm]
    sources : (nz, ny, nx) int32, for each node the row of `surface_mm` that is nearest to it,
        −1 where none is known; None where a field was made without
    surface_mm : what the surface is made of, float64 [mm]: points (n, 3), or triangles (n, 3, 3);
        (0, 3) without `sources`
    remarks : what the user should know about the data it was made from
    inwards : (n, 3) float64, unit directions inwards at points of `surface_mm`, or (0, 3)
    exact : the closest points are those of the surface itself, not of a fit, so that distances
        between nodes may be made from them
    """

    grid: Grid
    values: NDArray[np.float32]
    sources: NDArray[np.int32] | None
    surface_mm: FloatArray
    remarks: tuple[str, ...] = ()
    inwards: FloatArray = field_of(default_factory=lambda: np.empty((0, 3)))
    exact: bool = False

    @property
    def closest_point_of_each_node(self) -> NDArray[np.float32] | None:
        """The nearest surface point of each node, (nz, ny, nx, 3) float32 [mm]; made anew."""
        if self.sources is None:
            return None
        closest = np.empty((*self.grid.shape, 3), dtype=np.float32)
        for window in self.grid.slabs(8):
            rows = self.sources[window.z_first : window.z_last]
            closest[window.z_first : window.z_last] = closest_points_on_rows(
                self.surface_mm, rows.reshape(-1), window.node_points()
            ).reshape(*window.shape, 3)
        return closest

    def values_on_window(self, window: Window) -> NDArray[np.float32]:
        """Values at the nodes of any window: its own planes as they are, others interpolated."""
        if window.grid == self.grid:
            return self.values[window.z_first : window.z_last]
        return sample_distance(self, window.node_points()).astype(np.float32).reshape(window.shape)


def sample_distance(field: DistanceField, points: FloatArray) -> FloatArray:
    """Signed distance at any points.

    Trilinear between nodes; near the surface of an exact field of third order where that is
    smooth, and sharp at its edges and corners (`interpolate`).

    Outside the grid (where the body is not) it is the distance to the surface points stored at the
    grid's faces; a field without sources adds the distance to the grid's box instead.

    points : (n, 3) float64 [mm]; returns : (n,) float64 [mm]
    """
    points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    nodes = _in_nodes(field.grid, points)
    distance = np.ascontiguousarray(_sample_kernel(field.values, nodes)[:, 0])
    if field.exact:
        _sharpen(field, nodes, distance)
    out = _outside(field.grid, points)
    if out.any():
        distance[out] = _beyond(field, points[out], distance[out])
    return distance


def sample_gradient(field: DistanceField, points: FloatArray) -> FloatArray:
    """Gradient of the trilinear interpolant (of its border value outside); it points inwards.

    points : (n, 3) float64 [mm]; returns : (n, 3) float64, length about 1
    """
    points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    slopes = _sample_kernel(field.values, _in_nodes(field.grid, points))[:, 1:]
    gradient: FloatArray = slopes / field.grid.pitch_mm
    return gradient


def _sharpen(field: DistanceField, nodes: FloatArray, distance: FloatArray) -> None:
    assert field.sources is not None
    h = field.grid.pitch_mm
    surface = field.surface_mm[:, None] if field.surface_mm.ndim == 2 else field.surface_mm
    relative = np.ascontiguousarray((surface - np.asarray(field.grid.origin_mm)) / h)
    distance /= h
    refine_distances(
        np.clip(nodes, 0.0, np.asarray(field.grid.shape[::-1]) - 1.0), field.values,
        field.sources, relative, field.inwards, h, distance,
    )
    distance *= h


def _in_nodes(grid: Grid, points: FloatArray) -> FloatArray:
    nodes: FloatArray = (points - np.asarray(grid.origin_mm)) / grid.pitch_mm
    return nodes


def _outside(grid: Grid, points: FloatArray) -> NDArray[np.bool_]:
    last = np.asarray(grid.shape[::-1]) - 1
    nodes = _in_nodes(grid, points)
    outside: NDArray[np.bool_] = np.any((nodes < 0.0) | (nodes > last), axis=1)
    return outside


def _beyond(field: DistanceField, points: FloatArray, border: FloatArray) -> FloatArray:
    """Distance at points outside the grid, by the surface nearest to where the way in enters it."""
    origin, last = np.asarray(field.grid.origin_mm), np.asarray(field.grid.shape[::-1]) - 1
    nodes = _in_nodes(field.grid, points)
    enter = np.clip(nodes, 0, last)
    to_the_box = border - field.grid.pitch_mm * length(nodes - enter)
    if field.sources is None or not len(field.surface_mm):
        return to_the_box
    away = np.full(len(points), np.inf)
    for _ in range(ENTRIES_TRIED):
        x, y, z = np.rint(enter).astype(np.int64).T
        rows = field.sources[z, y, x]
        # A node may have no surface point of its own (-1): then the box is used.
        closest = closest_points_on_rows(field.surface_mm, np.maximum(rows, 0), points)
        away = np.where(rows >= 0, np.minimum(away, length(points - closest)), away)
        # The straight way from each point to there enters the grid at its last face.
        direction = (closest - origin) / field.grid.pitch_mm - nodes
        with np.errstate(divide="ignore", invalid="ignore"):
            faces = (np.clip(nodes, 0, last) - nodes) / direction
        part = np.nanmax(np.where(np.isfinite(faces), faces, 0.0), axis=1)
        enter = np.clip(nodes + part[:, None] * direction, 0, last)
    return np.where(np.isfinite(away), -away, to_the_box)


@kernel
def _sample_kernel(values: NDArray[np.float32], nodes: FloatArray) -> FloatArray:
    """(n, 4): trilinear value and its slopes per node along x, y, z; nodes in node units."""
    nz, ny, nx = values.shape
    result = np.empty((nodes.shape[0], 4), dtype=np.float64)
    for n in range(nodes.shape[0]):
        x = min(max(nodes[n, 0], 0.0), nx - 1.0)
        y = min(max(nodes[n, 1], 0.0), ny - 1.0)
        z = min(max(nodes[n, 2], 0.0), nz - 1.0)
        i, j, k = min(int(x), nx - 2), min(int(y), ny - 2), min(int(z), nz - 2)
        u, v, w = x - i, y - j, z - k
        result[n, 0] = 0.0
        for c in range(4):
            result[n, c] = 0.0
        for dk in range(2):
            for dj in range(2):
                a, b = values[k + dk, j + dj, i], values[k + dk, j + dj, i + 1]
                wk = w if dk else 1.0 - w
                wj = v if dj else 1.0 - v
                along = a * (1.0 - u) + b * u
                result[n, 0] += wk * wj * along
                result[n, 1] += wk * wj * (b - a)
                result[n, 2] += wk * (1.0 if dj else -1.0) * along
                result[n, 3] += wj * (1.0 if dk else -1.0) * along
    return result
