"""Heights at which a body begins or ends: where sections elsewhere could miss a piece of it."""

import numpy as np
import pytest

from lmctl.part.bodies.formulas import Box, Sphere
from lmctl.part.turning_heights import _of_mesh, turning_heights_mm


def prism(low, high, first=0):
    """Corners' heights and triangles of a box."""
    z = np.array([low] * 4 + [high] * 4, dtype=float)
    sides = [(k, (k + 1) % 4, 4 + k) for k in range(4)]
    sides += [((k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    lids = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
    return z, np.array([*sides, *lids], dtype=np.int64) + first


def test_of_two_boxes_each_has_its_own():
    (za, a), (zb, b) = prism(0, 4), prism(1.2, 1.4, first=8)
    heights = _of_mesh(np.concatenate([za, zb]), np.vstack([a, b]))
    assert heights == pytest.approx([0, 1.2, 1.4, 4])


def test_corners_on_a_slope_are_none():
    z = np.array([0.0, 1.0, 2.0, 3.0])
    assert _of_mesh(z, np.array([[0, 1, 2], [1, 3, 2], [0, 2, 3], [0, 3, 1]])) == pytest.approx(
        [0, 3])


@pytest.mark.parametrize(("body", "heights"), [
    (Box((0, 0, 1), (2, 3, 4)), (1, 4)), (Sphere((0, 0, 5), 2.0), (3, 7))])
def test_of_formulas_their_lowest_and_highest(body, heights):
    assert turning_heights_mm(body) == pytest.approx(heights)
