"""Kernels on a section's raster beside scipy: pieces, tracks in reach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from lmctl.plan.geometry.raster_pieces import connected_pieces, nodes_of_pieces
from lmctl.plan.geometry.track_reach import reaches_missed


@pytest.mark.parametrize("share", [0.0, 0.3, 0.55, 0.6, 0.9, 1.0])
def test_pieces_are_those_of_scipy(share: float) -> None:
    rng = np.random.default_rng(round(share * 100))
    for shape in ((1, 1), (1, 17), (23, 1), (40, 61)):
        values = np.where(rng.random(shape) < share, rng.random(shape) + 0.1, -1.0)
        values = values.astype(np.float32)
        label, peaks = connected_pieces(values)
        expected, count = ndimage.label(values > 0)
        np.testing.assert_array_equal(label, expected - 1)
        highest = ndimage.maximum_position(values, expected, np.arange(1, count + 1))
        np.testing.assert_array_equal(
            peaks, [np.ravel_multi_index(place, shape) for place in highest])
        for number, (j, i) in enumerate(nodes_of_pieces(label, count)):
            np.testing.assert_array_equal(np.argwhere(label == number), np.stack([j, i], axis=1))


def test_a_spiral_is_one_piece() -> None:
    """Its runs join only at its end, by the longest way."""
    values = np.zeros((31, 31), np.float32)
    for ring in range(0, 15, 2):
        values[ring, ring:31 - ring] = values[30 - ring, ring:31 - ring] = 1
        values[ring:31 - ring, ring] = values[ring:31 - ring, 30 - ring] = 1
        values[ring + 1, ring] = 0
        values[ring + 2, ring + 1] = 1
    label, peaks = connected_pieces(values)
    assert len(peaks) == ndimage.label(values)[1]
    assert label.max() == len(peaks) - 1


def test_reach_is_that_of_a_tree() -> None:
    rng = np.random.default_rng(3)
    reach = np.array([0.9, 1.3, 2.0])
    for count in (1, 5, 200):
        points = rng.uniform(-5, 5, (count, 2))
        places = rng.uniform(-12, 12, (800, 2))
        gap, _ = cKDTree(points).query(places)
        np.testing.assert_array_equal(
            reaches_missed(places, points, reach), (gap[:, None] > reach).sum(axis=1))
