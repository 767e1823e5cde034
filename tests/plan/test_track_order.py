"""The order in which a layer's tracks are deposited."""

from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.plan.geometry import LayerFigures, LayerGeometry
from lmctl.plan.sequence.track_order import GOLDEN_ANGLE, order_tracks

ORIGIN = np.zeros(2)


def ring(radius, n=360):
    turn = np.linspace(0, 2 * np.pi, n + 1)
    points = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points[-1] = points[0]
    return points


def line(y, n=20):
    return np.column_stack([np.linspace(0, 10, n), np.full(n, y)])


def geometry(tracks, fields):
    """A layer of these tracks, closed where they end where they begin."""
    n = sum(len(track) for track in tracks)
    return LayerGeometry(
        layer=0, z_mm=0.0, points_mm=np.vstack([np.empty((0, 2)), *tracks]),
        starts=np.cumsum([0, *(len(track) for track in tracks)]), strip_width_mm=np.ones(n),
        fractions=np.vstack([np.empty((0, 2)), *fields]) if fields else np.empty((0, 2)),
        is_closed=np.array([(t[0] == t[-1]).all() for t in tracks], dtype=bool),
        island=np.zeros(len(tracks), dtype=np.intp), outline_mm=np.empty((0, 2)),
        outline_starts=np.zeros(1, dtype=np.intp), figures=LayerFigures(1, 1, 0, 0, 1))


def order(tracks, values, turn=0, at=ORIGIN, last=None, cost=lambda a, b: 0.0, seam="spread"):
    """The tracks in order, each with its points and mixtures."""
    fields = [v if isinstance(v, np.ndarray) else np.tile([1 - v, v], (len(t), 1))
              for t, v in zip(tracks, values, strict=True)]
    found = order_tracks(geometry(tracks, fields), turn, at, last, 0.02, cost, seam)
    slices = [slice(a, b) for a, b in zip(found.starts[:-1], found.starts[1:], strict=True)]
    return [SimpleNamespace(points=found.points_mm[s], fractions=found.fractions[s],
                            along=found.along_mm[s]) for s in slices]


def radii(traces):
    return [round(float(np.hypot(*t.points[0]))) for t in traces]


def angle_of(trace):
    return float(np.arctan2(trace.points[0, 1], trace.points[0, 0]))


def test_one_sweep_through_the_mixtures():
    tracks = [ring(r) for r in (3, 1, 5, 2, 4)]
    second = [t.fractions[0, 1] for t in order(tracks, [0.3, 0.1, 0.5, 0.2, 0.4])]
    assert second == sorted(second) or second == sorted(second, reverse=True)


def test_the_next_layer_sweeps_back():
    tracks = [ring(r) for r in range(1, 11)]
    values = [0.1 * r for r in range(1, 11)]
    mixture = None
    travelled = 0.0
    for turn in range(6):
        traces = order(tracks, values, turn, last=mixture)
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


def test_spread_seams_turn_by_the_golden_angle():
    angles = np.unwrap([angle_of(order([ring(10)], [0.5], turn)[0]) for turn in range(5)])
    steps = np.diff(angles) % (2 * np.pi)
    assert steps == pytest.approx(np.full(4, GOLDEN_ANGLE), abs=0.02)


def test_aligned_seams_stay_and_a_point_draws_them_near():
    tracks = [ring(10), ring(7)]
    for turn in range(4):
        aligned = [angle_of(trace) for trace in order(tracks, [0.5, 0.5], turn, seam="aligned")]
        assert aligned == pytest.approx([0, 0], abs=0.02)
        near = [angle_of(t) for t in order(tracks, [0.5, 0.5], turn, seam=(0.0, -50.0))]
        assert near == pytest.approx([-np.pi / 2] * 2, abs=0.02)


def test_the_direction_alternates():
    def area(points):
        x, y = points.T
        return np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])

    assert area(order([ring(10)], [0.5], 0)[0].points) > 0
    assert area(order([ring(10)], [0.5], 1)[0].points) < 0


def test_a_track_of_varying_mixture_starts_where_the_nozzle_already_is():
    second = 0.5 + 0.3 * np.cos(np.linspace(0, 2 * np.pi, 361))
    field = np.stack([1 - second, second], axis=1)
    trace = order([ring(10)], [field], last=np.array([0.7, 0.3]))[0]
    assert trace.fractions[0, 1] == pytest.approx(0.3, abs=0.01)
    assert (trace.points[0] == trace.points[-1]).all()


def test_nothing_is_lost_or_doubled():
    rng = np.random.default_rng(3)
    tracks = [ring(r) for r in range(1, 9)] + [line(y) for y in range(8)]
    traces = order(tracks, rng.uniform(0, 1, len(tracks)).tolist(), turn=1)
    length = sum(np.linalg.norm(np.diff(t, axis=0), axis=1).sum() for t in tracks)
    deposited = sum(np.linalg.norm(np.diff(t.points, axis=0), axis=1).sum() for t in traces)
    assert len(traces) == len(tracks)
    assert deposited == pytest.approx(length)
    assert sum(t.along[-1] - t.along[0] for t in traces) == pytest.approx(length)
    assert (np.diff(np.concatenate([t.along for t in traces])) > 0).all()


def test_three_materials_are_swept_along_their_main_change():
    tracks = [ring(r) for r in (1, 2, 3, 4)]
    mixtures = [[0.9, 0.1, 0.0], [0.1, 0.7, 0.2], [0.6, 0.3, 0.1], [0.3, 0.5, 0.2]]
    fields = [np.tile(m, (361, 1)) for m in mixtures]
    layer = geometry(tracks, [field[:, :2] for field in fields])
    layer = LayerGeometry(**(layer.__dict__ | {"fractions": np.vstack(fields)}))
    found = order_tracks(layer, 0, ORIGIN, None, 0.02, lambda a, b: 0.0)
    radius = [round(float(np.hypot(*found.points_mm[s]))) for s in found.starts[:-1]]
    assert radius in ([1, 3, 4, 2], [2, 4, 3, 1])


def test_an_empty_layer():
    assert order([], []) == []
