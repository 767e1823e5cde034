"""The medial axis of a slice: where two walls are equally near, and how near.

Voronoi edges of densely sampled outlines, kept where the two nearest walls lie on *opposite*
sides (they subtend 120° or more): those are where tracks from both sides meet. Branches running
into corners and the fringe that sampling noise grows are not.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError, Voronoi

from lmctl.field.plane import PlaneGrid
from lmctl.plan.plane_values import plane_values
from lmctl.plan.polyline import densified, simplified

FloatArray = NDArray[np.float64]

#: The least angle under which the two walls are seen is 120°: their points' distance over R.
_OPPOSITE = np.sqrt(3.0)


@dataclass(frozen=True)
class MedialAxis:
    """Voronoi edges between opposite walls.

    points : (v, 2) float64 [mm]
    radius_mm : (v,) float64, distance to the outline
    edges : (e, 2) intp into both
    centres : (c, 2) float64 [mm], of all circles in the outline that touch it in three places
    centre_radius_mm : (c,) float64; the largest is as deep as the slice is anywhere
    """

    points: FloatArray
    radius_mm: FloatArray
    edges: NDArray[np.intp]
    centres: FloatArray
    centre_radius_mm: FloatArray

    def edge_lengths_mm(self) -> FloatArray:
        first, last = self.points[self.edges[:, 0]], self.points[self.edges[:, 1]]
        return np.asarray(np.linalg.norm(last - first, axis=1))

    def edge_radius_mm(self) -> FloatArray:
        return np.asarray(self.radius_mm[self.edges].mean(axis=1))

    def chains(self, edge_mask: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
        """The chosen edges joined into chains of vertices between ends and branch points.

        Each edge is used once; a ring repeats its first vertex last.
        """
        neighbours: dict[int, list[int]] = defaultdict(list)
        for a, b in self.edges[edge_mask].tolist():
            neighbours[a].append(b)
            neighbours[b].append(a)
        used: set[tuple[int, int]] = set()
        chains = []
        ends = sorted(v for v, near in neighbours.items() if len(near) != 2)
        for start in [*ends, *sorted(neighbours)]:  # what has no end is a ring
            for step in neighbours[start]:
                if (start, step) in used:
                    continue
                walk = [start, step]
                used |= {(start, step), (step, start)}
                while len(neighbours[walk[-1]]) == 2 and walk[-1] != start:
                    ahead = next(v for v in neighbours[walk[-1]] if v != walk[-2])
                    if (walk[-1], ahead) in used:
                        break
                    used |= {(walk[-1], ahead), (ahead, walk[-1])}
                    walk.append(ahead)
                chains.append(np.array(walk, dtype=np.intp))
        return chains


def medial_axis(
    loops: list[FloatArray], distance: NDArray[np.float32], grid: PlaneGrid, spacing_mm: float
) -> MedialAxis:
    """The medial axis of the region within closed loops.

    distance : (ny, nx) float32, in-plane signed distance to the loops on `grid`
    spacing_mm : of the points the loops are sampled at; radii err by about spacing² / 8 R
    """
    empty = MedialAxis(
        np.empty((0, 2)), np.empty(0), np.empty((0, 2), np.intp), np.empty((0, 2)), np.empty(0))
    walls = [_sampled(loop, spacing_mm) for loop in loops]
    sites = np.unique(np.vstack(walls), axis=0) if walls else np.empty((0, 2))
    if len(sites) < 4:
        return empty
    try:
        diagram = Voronoi(sites)
    except QhullError:  # all sites on one line: a slice without area
        return empty
    edges = np.asarray(diagram.ridge_vertices, dtype=np.intp)
    pairs = np.asarray(diagram.ridge_points, dtype=np.intp)
    radius = np.zeros(len(diagram.vertices))
    for end in edges.T:
        met = end >= 0
        reach = sites[pairs[met, 0]] - diagram.vertices[end[met]]
        radius[end[met]] = np.linalg.norm(reach, axis=1)
    inside = plane_values(distance, grid, diagram.vertices) > 0
    finite = (edges >= 0).all(axis=1) & (edges[:, 0] != edges[:, 1])
    edges, pairs = edges[finite], pairs[finite]
    chord = np.linalg.norm(sites[pairs[:, 0]] - sites[pairs[:, 1]], axis=1)
    # At both ends: an edge between neighbours on one wall passes through it.
    opposite = inside[edges] & (chord[:, None] >= _OPPOSITE * radius[edges])
    edges = edges[opposite.all(axis=1)]
    used, ends = np.unique(edges, return_inverse=True)
    return MedialAxis(diagram.vertices[used], radius[used], ends.reshape(edges.shape),
                      diagram.vertices[inside], radius[inside])


def _sampled(loop: FloatArray, spacing_mm: float) -> FloatArray:
    """A loop's corners and points between them, the last point not repeated."""
    flat = np.column_stack([loop, np.zeros(len(loop))])
    corners = loop[simplified(flat, spacing_mm / 50, np.array([len(loop) // 2]))]
    return densified(corners, spacing_mm)[:-1]
