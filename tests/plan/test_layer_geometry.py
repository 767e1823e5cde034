"""The interface between the stages: flat arrays that agree with each other and travel."""

import pickle

import numpy as np

from lmctl.plan.geometry import layer_geometry
from lmctl.preflight.placement import place_part


def test_a_layer_is_flat_arrays_that_agree(make_part, shapes, profile):
    part = make_part(shapes["islands"], lambda p: p[:, 0] / 20)
    geometry = layer_geometry(part, place_part(part, profile), 1)
    n, m = len(geometry.points_mm), geometry.n_tracks
    assert geometry.layer == 1
    assert geometry.starts[0] == 0
    assert geometry.starts[-1] == n
    assert np.diff(geometry.starts).min() >= 2
    assert len(geometry.strip_width_mm) == n
    assert geometry.fractions.shape == (n, 2)
    assert np.allclose(geometry.fractions.sum(axis=1), 1, atol=1e-6)
    assert len(geometry.is_closed) == len(geometry.island) == m
    assert set(geometry.island) == {0, 1, 2}
    for number in range(m):
        points = geometry.points_mm[geometry.track(number)]
        assert np.array_equal(points[0], points[-1]) == geometry.is_closed[number]
    assert [len(loop) for loop in geometry.loops()] == [721, 5, 721]
    assert geometry.figures.strip_mm2 > 0


def test_a_layer_travels_to_another_process_whole(make_part, shapes, profile):
    part = make_part(shapes["disc"], lambda p: 0.5)
    geometry = layer_geometry(part, place_part(part, profile), 0)
    again = pickle.loads(pickle.dumps(geometry))
    assert np.array_equal(again.points_mm, geometry.points_mm)
    assert again.figures == geometry.figures
