"""What is beside a track: the direction to its left, and the material field across its bead."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.layer_geometry import ACROSS, LayerGeometry


def left_of_tracks(geometry: LayerGeometry) -> FloatArray:
    """Unit vectors to the left of the tracks of a layer at each of their vertices, (n, 2)."""
    ahead = np.zeros_like(geometry.points_mm)
    step = np.diff(geometry.points_mm, axis=0)
    step[geometry.starts[1:-1] - 1] = 0.0  # from one track to the next
    ahead[:-1] += step
    ahead[1:] += step
    closed = np.flatnonzero(geometry.is_closed)
    first, last = geometry.starts[closed], geometry.starts[closed + 1] - 1
    ahead[first] = ahead[last] = step[first] + step[last - 1]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-12)[:, None]
    return np.column_stack([-ahead[:, 1], ahead[:, 0]])


def fractions_across(
    geometry: LayerGeometry, bead_mm: float, composition: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """The material field across the bead at each vertex, (n, ACROSS, materials).

    composition : at places (k, 3)
    """
    left, points = left_of_tracks(geometry), geometry.points_mm
    height = np.full(len(points), geometry.z_mm)
    return np.stack([
        composition(np.column_stack([points + beside * bead_mm / 2 * left, height]))
        for beside in np.linspace(-1.0, 1.0, ACROSS)], axis=1)
