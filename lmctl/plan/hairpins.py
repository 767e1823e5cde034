"""Two tracks where no raster can part them: out along one side of a middle, back along the other.

A contour at depth a/2 is the edge of all discs of radius R − a/2 around the medial axis of depth
R. Where that radius is less than a raster pitch, the raster shows blobs or nothing, so there the
contour is drawn around the axis itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.polyline import arc_lengths, at_lengths, densified

FloatArray = NDArray[np.float64]

_RING_POINTS = 16


def around(points: FloatArray, way_mm: FloatArray, spacing_mm: float) -> list[FloatArray]:
    """Closed loops at `way_mm` from a line: one about an open line, one on either side of a ring.

    points : (n, 2) float64 [mm], a ring repeats its first point last
    way_mm : (n,) float64, ≥ 0, much less than the line is long
    returns : (k, 3) float64 each: x, y, and the way there; points at most `spacing_mm` apart
    """
    along = arc_lengths(points)
    at = np.linspace(0, along[-1], max(2, int(np.ceil(along[-1] / spacing_mm))) + 1)
    line, way = at_lengths(points, at), np.interp(at, along, way_mm)
    if np.array_equal(points[0], points[-1]):
        ahead = np.roll(line[:-1], -1, axis=0) - np.roll(line[:-1], 1, axis=0)
        ahead = np.vstack([ahead, ahead[:1]])
        sides = _beside(line, ahead, way), _beside(line, ahead, -way)
        return [densified(np.column_stack([side, way]), spacing_mm) for side in sides]
    ahead = np.gradient(line, axis=0)
    forth, back = _beside(line, ahead, way), _beside(line, ahead, -way)[::-1]
    tip = line[-1] + way[-1] * _unit(ahead[-1:])[0]
    heel = line[0] - way[0] * _unit(ahead[:1])[0]
    loop = np.column_stack([
        np.vstack([heel, forth, tip, back, heel]),
        np.concatenate([way[:1], way, way[-1:], way[::-1], way[:1]])])
    loop = loop[np.append(True, np.linalg.norm(np.diff(loop[:, :2], axis=0), axis=1) > 0)]
    return [densified(loop, spacing_mm)]


def ring(centre: FloatArray, radius_mm: float) -> FloatArray:
    """A circle, (k, 2) float64 [mm], its first point repeated last."""
    turn = np.linspace(0, 2 * np.pi, _RING_POINTS + 1)
    loop = centre + radius_mm * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    loop[-1] = loop[0]
    return loop


def _beside(line: FloatArray, ahead: FloatArray, way_mm: FloatArray) -> FloatArray:
    """The line moved to its left."""
    unit = _unit(ahead)
    return np.asarray(line + way_mm[:, None] * np.stack([-unit[:, 1], unit[:, 0]], axis=1))


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
