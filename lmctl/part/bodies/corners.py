"""Correct outlines read off a raster: move points onto the surface and restore corners.

Along an edge of the raster a distance is not quite linear, so points lie a little beside the
surface. Between two neighbouring points the raster draws a chord. Where the surface turns
sharply between them, its tangents at both meet in the corner. A corner lies on the outline and the
chord's middle does not; on a round edge the tangents meet off the outline.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

#: Cosine between directions at neighbouring points, above which there is no corner: 8°.
STRAIGHT_MIN_COSINE = 0.99

#: A corner is farther from its chord than the chord is long by this at most.
MAX_CORNER_DISTANCE_CHORDS = 3.0

#: A direction whose part in the plane is shorter does not define the outline.
MIN_IN_PLANE_LENGTH = 0.1

#: A corner is on the outline where it is off by so much less than the chord's middle.
MAX_CORNER_ERROR_RATIO = 0.25


def restore_corners(
    loops: Sequence[FloatArray], z_mm: float, distance: Callable[[FloatArray], FloatArray],
    inward: Callable[[FloatArray], FloatArray],
) -> list[FloatArray]:
    """Closed loops (k, 2) [mm] at height z, their points on the surface, and with the corners that
    their chords cut.

    distance, inward : of the body, (n, 3) -> (n,) and (n, 3); zero on the outline
    """
    if not loops:
        return []
    start = np.vstack([loop[:-1] for loop in loops])
    sizes = np.array([len(loop) - 1 for loop in loops])
    following = np.arange(len(start)) + 1
    following[np.cumsum(sizes) - 1] -= sizes
    normal, size = _in_plane(inward, start, z_mm)
    step = distance(_at_height(start, z_mm)) / np.maximum(size, MIN_IN_PLANE_LENGTH)
    chord = np.linalg.norm(start[following] - start, axis=1)
    start = start - (np.clip(step, -chord, chord) * (size > MIN_IN_PLANE_LENGTH))[:, None] * normal
    normal, size = _in_plane(inward, start, z_mm)
    end = start[following]
    after = normal[following]
    turn = (normal * after).sum(axis=1)
    sharp = np.flatnonzero(
        (turn < STRAIGHT_MIN_COSINE) & (np.minimum(size, size[following]) > MIN_IN_PLANE_LENGTH))
    # Where the tangents at both ends meet: n · (x − p) = 0 and m · (x − q) = 0.
    n, m, p, q = normal[sharp], after[sharp], start[sharp], end[sharp]
    det = n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0]
    met = np.abs(det) > 1e-3
    sharp, det = sharp[met], det[met]
    n, m, p, q = n[met], m[met], p[met], q[met]
    across = (m * (q - p)).sum(axis=1)
    corner = p + np.stack([-n[:, 1], n[:, 0]], axis=1) * (across / det)[:, None]
    chord = np.linalg.norm(q - p, axis=1)
    middle = 0.5 * (p + q)
    near = np.linalg.norm(corner - middle, axis=1) <= MAX_CORNER_DISTANCE_CHORDS * chord
    sharp, corner, middle = sharp[near], corner[near], middle[near]
    if len(sharp) == 0:
        return _closed(start, sizes)
    off = np.abs(distance(_at_height(corner, z_mm)))
    good = off <= MAX_CORNER_ERROR_RATIO * np.abs(distance(_at_height(middle, z_mm)))
    sharp, corner = sharp[good], corner[good]
    points = np.insert(start, sharp + 1, corner, axis=0)
    own = np.repeat(np.arange(len(sizes)), sizes)
    return _closed(points, sizes + np.bincount(own[sharp], minlength=len(sizes)))


def _closed(points: FloatArray, sizes: NDArray[np.int64]) -> list[FloatArray]:
    """Points of all loops as loops, each with its first point repeated."""
    return [np.vstack([part, part[:1]]) for part in np.split(points, np.cumsum(sizes)[:-1])]


def _in_plane(
    inward: Callable[[FloatArray], FloatArray], points: FloatArray, z_mm: float
) -> tuple[FloatArray, FloatArray]:
    """The direction inwards in the plane, of length 1, and how long its part in the plane is."""
    normal = inward(_at_height(points, z_mm))[:, :2]
    size = np.linalg.norm(normal, axis=1)
    return normal / np.maximum(size, 1e-300)[:, None], size


def _at_height(points: FloatArray, z_mm: float) -> FloatArray:
    return np.column_stack([points, np.full(len(points), float(z_mm))])
