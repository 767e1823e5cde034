"""T-junctions: edges that run past a corner of their neighbours, cut in two there.

Where a program has divided a face but not the one beside it, the long edge of the one and the short
edges of the others cover each other, yet no edge has two triangles. Cutting the long one changes no
shape.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.part.sources.mesh_topology import directed_edges, edge_numbers

#: Rounds of cutting; each leaves at most half of an edge uncut, so few are ever needed.
MAX_ROUNDS = 30


def split_at_junctions(
    vertices: FloatArray, triangles: IntArray, within_mm: float
) -> tuple[IntArray, int]:
    """Triangles whose open edges are cut at the open corners that lie on them.

    within_mm : how far off an edge a corner may lie and be on it
    returns : triangles (k, 3); how many edges were cut
    """
    cuts = 0
    for _ in range(MAX_ROUNDS):
        edge, corner = _junctions(vertices, triangles, within_mm)
        if len(edge) == 0:
            break
        cuts += len(edge)
        owner, side = np.divmod(edge, 3)
        a, b, c = (triangles[owner, (side + k) % 3] for k in range(3))
        kept = np.ones(len(triangles), dtype=bool)
        kept[owner] = False
        triangles = np.vstack([
            triangles[kept], np.stack([a, corner, c], 1), np.stack([corner, b, c], 1)])
    return triangles, cuts


def _junctions(
    vertices: FloatArray, triangles: IntArray, within_mm: float
) -> tuple[IntArray, IntArray]:
    """Directed edges (numbers) that pass open corners, at most one of a triangle, and for each the
    corner nearest to its middle."""
    from scipy.spatial import cKDTree  # late: scipy takes as long to load as a small part

    number, counts = edge_numbers(triangles)
    open_edges = np.flatnonzero((counts % 2 == 1)[number])
    ends = directed_edges(triangles)[open_edges]
    rim = np.unique(ends)
    if len(rim) == 0:
        return open_edges[:0], rim
    start, end = vertices[ends[:, 0]], vertices[ends[:, 1]]
    middle, half = 0.5 * (start + end), 0.5 * np.linalg.norm(end - start, axis=1)
    found = cKDTree(vertices[rim]).query_ball_point(middle, half + within_mm)
    sizes = np.array([len(rows) for rows in found])
    edge = np.repeat(np.arange(len(ends)), sizes)
    corner = rim[np.concatenate([np.asarray(rows, dtype=np.int64) for rows in found])]
    direction = (end - start)[edge] / np.maximum(2 * half, 1e-300)[edge, None]
    offset = vertices[corner] - start[edge]
    along = (offset * direction).sum(axis=1)
    across = np.linalg.norm(offset - along[:, None] * direction, axis=1)
    third = triangles[open_edges[edge] // 3, (open_edges[edge] + 2) % 3]
    on_it = (
        (across <= within_mm) & (along > within_mm) & (along < 2 * half[edge] - within_mm)
        & (corner != ends[edge, 0]) & (corner != ends[edge, 1]) & (corner != third)
    )
    edge, corner = edge[on_it], corner[on_it]
    order = np.argsort(np.abs(along[on_it] - half[edge]), kind="stable")
    edge, corner = edge[order], corner[order]
    _, first = np.unique(open_edges[edge] // 3, return_index=True)
    return open_edges[edge[first]], corner[first]
