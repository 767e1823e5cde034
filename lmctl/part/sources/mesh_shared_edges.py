"""Edges that more than two triangles share, where solids touch: the solids parted there.

Around such an edge triangles that face out alternate: into a solid, out of it. Each belongs with
the next one on its solid's side. Corners are then doubled so that every edge has two triangles and
each solid a surface of its own.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.part.sources.mesh_topology import (
    connected_components,
    directed_edges,
    edge_counts,
    edge_numbers,
)


def split_at_shared_edges(
    vertices: FloatArray, triangles: IntArray
) -> tuple[FloatArray, IntArray]:
    """The same triangles on corners of which some are there several times.

    triangles : (m, 3), facing out; edges whose triangles do not face both ways equally often stay
        shared
    """
    if (edge_counts(triangles) == 2).all():
        return vertices, triangles
    number, counts = edge_numbers(triangles)
    edges = directed_edges(triangles)
    order = np.argsort(number, kind="stable")
    pairs = [order[(counts == 2)[number[order]]].reshape(-1, 2)]
    shared = order[(counts > 2)[number[order]]]
    for rows in np.split(shared, np.flatnonzero(np.diff(number[shared])) + 1):
        pairs.append(_paired(vertices, triangles, edges, rows))
    paired = np.vstack(pairs)
    # The corner of a triangle at each end of an edge is one with that of its neighbour there.
    side, beside = paired[:, 0], paired[:, 1]
    start, end = side, _next(side)
    against = edges[side, 0] == edges[beside, 1]
    links = np.vstack([
        np.stack([start, np.where(against, _next(beside), beside)], axis=1),
        np.stack([end, np.where(against, beside, _next(beside))], axis=1),
    ])
    corner = connected_components(links, 3 * len(triangles))
    _, first, rows = np.unique(corner, return_index=True, return_inverse=True)
    return vertices[triangles.ravel()[first]], rows.reshape(-1, 3)


def _next(corner: IntArray) -> IntArray:
    """The number of the corner after one in its triangle; edges have their first corner's."""
    following: IntArray = corner - corner % 3 + (corner + 1) % 3
    return following


def _paired(
    vertices: FloatArray, triangles: IntArray, edges: IntArray, rows: IntArray
) -> IntArray:
    """Pairs (k, 2) of the directed edges `rows` that share an edge, smallest solid angles first.

    Where they do not face both ways equally often all are left together.
    """
    a, b = np.sort(edges[rows[0]])
    forward = edges[rows, 0] == a
    if 2 * int(forward.sum()) != len(rows):
        return np.stack([rows[:-1], rows[1:]], axis=1)
    along = vertices[b] - vertices[a]
    along = along / max(float(np.linalg.norm(along)), 1e-300)
    third = triangles.ravel()[_next(_next(rows))]
    away = vertices[third] - vertices[a]
    away = away - (away @ along)[:, None] * along
    aside = away[0] / max(float(np.linalg.norm(away[0])), 1e-300)
    angle = np.arctan2(away @ np.cross(along, aside), away @ aside)
    # A triangle that runs forward has its solid where the angle falls.
    ahead, behind = np.flatnonzero(forward), np.flatnonzero(~forward)
    fall = np.mod(angle[ahead][:, None] - angle[behind][None] - 1e-9, 2 * np.pi)
    found = []
    for flat in np.argsort(fall, axis=None, kind="stable"):
        one, other = np.unravel_index(int(flat), fall.shape)
        if np.isfinite(fall[one, other]):
            found.append((rows[ahead[one]], rows[behind[other]]))
            fall[one, :] = fall[:, other] = np.inf
    return np.array(found, dtype=np.int64)
