"""The order in which a layer's tracks are laid."""

import numpy as np
import pytest

from lmctl.plan.order import GOLDEN_ANGLE, arrange
from lmctl.plan.tracks import Track

ORIGIN = np.zeros(2)


def ring(radius, n=360):
    turn = np.linspace(0, 2 * np.pi, n + 1)
    points = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points[-1] = points[0]
    return Track(points, np.ones(n + 1), True, 0)


def line(y, n=20):
    return Track(np.column_stack([np.linspace(0, 10, n), np.full(n, y)]), np.ones(n), False, 0)


def even(track, second):
    return np.tile([1 - second, second], (len(track.points), 1))


def no_cost(_a, _b):
    return 0.0


def order(tracks, values, layer=0, at=ORIGIN, last=None, cost=no_cost):
    fields = [v if isinstance(v, np.ndarray) else even(t, v)
              for t, v in zip(tracks, values, strict=True)]
    return arrange(tracks, fields, layer, at, last, 0.02, cost)


def radii(traces):
    return [round(float(np.hypot(*t.points[0]))) for t in traces]


def test_one_sweep_through_the_mixtures():
    tracks = [ring(r) for r in (3, 1, 5, 2, 4)]
    traces = order(tracks, [0.3, 0.1, 0.5, 0.2, 0.4])
    second = [t.fractions[0, 1] for t in traces]
    assert second == sorted(second) or second == sorted(second, reverse=True)


def test_the_next_layer_sweeps_back():
    tracks = [ring(r) for r in range(1, 11)]
    values = [0.1 * r for r in range(1, 11)]
    mixture = None
    travelled = 0.0
    for layer in range(6):
        traces = order(tracks, values, layer, last=mixture)
        for trace in traces:
            if mixture is not None:
                travelled += abs(trace.fractions[0, 1] - mixture[1])
            mixture = trace.fractions[-1]
    assert travelled == pytest.approx(6 * 0.9)  # |c_max − c_min| a layer, no more


def test_the_first_sweep_goes_where_changing_is_quicker():
    """Running a hopper empty takes long; starting it does not."""
    tracks = [ring(r) for r in (1, 2, 3)]

    def cost(start, end):
        return 10.0 if end[1] < start[1] else 1.0

    assert radii(order(tracks, [0.0, 0.1, 0.2], cost=cost)) == [1, 2, 3]
    assert radii(order(tracks, [0.2, 0.1, 0.0], cost=cost)) == [3, 2, 1]


def test_equal_mixtures_go_by_nearness():
    tracks = [line(y) for y in (0, 3, 1, 2)]
    traces = order(tracks, [0.5] * 4, at=np.array([0.0, 3.4]))
    assert [t.points[0, 1] for t in traces] == [3, 2, 1, 0]
    assert [t.points[0, 0] for t in traces] == [0, 10, 0, 10]  # entered at the nearer end


def test_starts_turn_by_the_golden_angle():
    starts = [order([ring(10)], [0.5], layer)[0].points[0] for layer in range(5)]
    angles = np.unwrap([np.arctan2(y, x) for x, y in starts])
    steps = np.diff(angles) % (2 * np.pi)
    assert steps == pytest.approx(np.full(4, GOLDEN_ANGLE), abs=0.02)


def test_the_sense_alternates():
    def area(points):
        x, y = points.T
        return np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])

    assert area(order([ring(10)], [0.5], 0)[0].points) > 0
    assert area(order([ring(10)], [0.5], 1)[0].points) < 0


def test_a_track_of_varying_mixture_starts_where_the_nozzle_already_is():
    track = ring(10)
    second = 0.5 + 0.3 * np.cos(np.linspace(0, 2 * np.pi, 361))
    field = np.stack([1 - second, second], axis=1)
    trace = order([track], [field], last=np.array([0.7, 0.3]))[0]
    assert trace.fractions[0, 1] == pytest.approx(0.3, abs=0.01)
    assert (trace.points[0] == trace.points[-1]).all()
    assert trace.closed


def test_nothing_is_lost_or_doubled():
    rng = np.random.default_rng(3)
    tracks = [ring(r) for r in range(1, 9)] + [line(y) for y in range(8)]
    values = rng.uniform(0, 1, len(tracks)).tolist()
    traces = order(tracks, values)
    length = sum(t.length_mm for t in tracks)
    laid = sum(np.linalg.norm(np.diff(t.points, axis=0), axis=1).sum() for t in traces)
    assert len(traces) == len(tracks)
    assert laid == pytest.approx(length)


def test_three_materials_are_swept_along_their_main_change():
    tracks = [ring(r) for r in (1, 2, 3, 4)]
    mixtures = [[0.9, 0.1, 0.0], [0.1, 0.7, 0.2], [0.6, 0.3, 0.1], [0.3, 0.5, 0.2]]
    fields = [np.tile(m, (361, 1)) for m in mixtures]
    traces = arrange(tracks, fields, 0, ORIGIN, None, 0.02, no_cost)
    assert radii(traces) in ([1, 3, 4, 2], [2, 4, 3, 1])


def test_an_empty_layer():
    assert order([], []) == []
