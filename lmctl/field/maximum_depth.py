"""The deepest place of a stored field, which is rarely one of its nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.features import length
from lmctl.field.field import DistanceField
from lmctl.field.sweep import propagate_closest_points
from lmctl.field.triangles import closest_points_on_rows

MAX_MAXIMA_TRIED = 16  # local maxima looked into, deepest first
SEARCH_RADIUS_NODES = 2  # to each side of one: their surface points bound how deep it can be there
ROUNDING_PITCHES = 1e-6  # pitches
# cosine: a way in that leaves the surface's own direction by more is from an edge
STRAIGHT_MIN_COSINE = 0.99


def find_maximum_depth(field: DistanceField) -> tuple[float, FloatArray]:
    """The greatest distance from the surface inside, and a place where it is reached.

    Around a node that is a local maximum, every neighbour stores a surface point and the plane
    perpendicular to the way there. The deepest place is the one farthest inside all these planes,
    which linear programming finds: exactly between flat faces and within spheres, to second order
    in the pitch elsewhere.

    field : with sources, and with an inside
    returns : [mm]; (3,) float64 x, y, z [mm]. At least the greatest value of a node
    """
    from scipy.ndimage import maximum_filter  # late: scipy takes as long to load as a small part

    values, grid = field.values, field.grid
    best = np.unravel_index(int(values.argmax()), values.shape)
    origin = np.asarray(grid.origin_mm)
    depth, place = float(values[best]), origin + grid.pitch_mm * np.array(best[::-1], dtype=float)
    if field.sources is None:
        return depth, place
    # A node within half a cell of the deepest place is less deep by no more than the way there.
    nearly = values > depth - np.sqrt(0.75) * grid.pitch_mm
    summits = np.argwhere(nearly & (values == maximum_filter(values, 3)))
    order = np.argsort(-values[tuple(summits.T)], kind="stable")[:MAX_MAXIMA_TRIED]
    sources = _known_everywhere(field, summits[order])
    for summit in summits[order]:
        found = _between_planes(field, sources, summit)
        if found is not None and found[0] > depth + ROUNDING_PITCHES * grid.pitch_mm:
            depth, place = found
    return depth, place


def _known_everywhere(field: DistanceField, summits: NDArray[np.int64]) -> NDArray[np.int32]:
    """Sources, swept to the nodes that have none, where the summits' are among these."""
    assert field.sources is not None
    if np.all(field.sources[tuple(summits.T)] >= 0):
        return field.sources
    sources = field.sources.copy()
    propagate_closest_points(sources, field.surface_mm, field.grid)
    return sources


def _between_planes(
    field: DistanceField, sources: NDArray[np.int32], summit: NDArray[np.int64]
) -> tuple[float, FloatArray] | None:
    from scipy.optimize import linprog  # late, as above

    grid = field.grid
    box = tuple(
        slice(max(0, at - SEARCH_RADIUS_NODES), at + SEARCH_RADIUS_NODES + 1) for at in summit
    )
    k, j, i = (axis.ravel() for axis in np.mgrid[box])
    nodes = np.asarray(grid.origin_mm) + grid.pitch_mm * np.stack([i, j, k], axis=1)
    inside = field.values[k, j, i] > 0.0
    nodes, rows = nodes[inside], sources[k, j, i][inside]
    closest = closest_points_on_rows(field.surface_mm, rows, nodes)
    away = length(nodes - closest)
    off = away > 0.0
    nodes, rows, closest = nodes[off], rows[off], closest[off]
    inwards = (nodes - closest) / away[off, None]
    if len(field.inwards):
        # Feet carried over from other nodes are a little beside; the direction there is not.
        own = field.inwards[rows]
        smooth = np.einsum("ij,ij->i", own, inwards) > STRAIGHT_MIN_COSINE
        inwards[smooth] = own[smooth]
    # Farthest inside all planes: the greatest t with inwards · (place − closest point) ≥ t.
    middle = np.asarray(grid.origin_mm) + grid.pitch_mm * summit[::-1]
    room = SEARCH_RADIUS_NODES * grid.pitch_mm
    solved = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.hstack([-inwards, np.ones((len(inwards), 1))]),
        b_ub=np.einsum("ij,ij->i", inwards, middle - closest),
        bounds=[(-room, room)] * 3 + [(None, None)],
    )
    if not solved.success:
        return None
    place = middle + solved.x[:3]
    # No plane is farther than its surface: the distance to the surface itself decides.
    there = length(place - closest_points_on_rows(field.surface_mm, rows,
                                                  np.tile(place, (len(rows), 1))))
    return min(float(solved.x[3]), float(there.min())), place
