"""Tracks of one mixture are deposited nearest first, whatever their number."""

from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.plan.sequence.track_order import order_tracks

ORIGIN = np.zeros(2)


def layer(tracks):
    """A layer of short tracks of one mixture, (k, 2) each; closed where they end as they begin."""
    starts = np.cumsum([0, *(len(track) for track in tracks)])
    return SimpleNamespace(
        n_tracks=len(tracks), points_mm=np.vstack(tracks), starts=starts,
        strip_width_mm=np.ones(starts[-1]), fractions=np.full((starts[-1], 2), 0.5),
        is_closed=np.array([(t[0] == t[-1]).all() for t in tracks]), is_directed=None,
        melted=None, designed=None, copy=None, rounds=None)


def entries(track, is_closed):
    """Where a track may be entered: an open one at both ends, a closed one nearest to angle 0."""
    return [track[0], track[-1]] if not is_closed else [track[0]]


def nearest_first(tracks, at):
    """The rule itself: the nearest entry of those left, of equal ones the lowest number."""
    left, order = list(range(len(tracks))), []
    while left:
        away = [min(np.hypot(*(np.array(place) - at)) for place in entries(
            tracks[k], (tracks[k][0] == tracks[k][-1]).all())) for k in left]
        chosen = left.pop(int(np.argmin(away)))
        track = tracks[chosen]
        order.append(chosen)
        if (track[0] == track[-1]).all() or (
                np.hypot(*(track[-1] - at)) < np.hypot(*(track[0] - at))):
            at = track[0]
        else:
            at = track[-1]
    return order


def strokes(rng, count, size):
    begin = rng.uniform(0, size, (count, 2))
    return list(np.stack([begin, begin + rng.uniform(-1, 1, (count, 2))], axis=1))


@pytest.mark.parametrize("spread", [(50.0, 50.0), (50.0, 0.0), (0.0, 0.0), (5000.0, 1.0)])
def test_the_nearest_track_comes_next(spread):
    rng = np.random.default_rng(5)
    tracks = strokes(rng, 150, 1.0)
    tracks = [track + rng.uniform(0, 1, 2) * np.array(spread) for track in tracks]
    found = order_tracks(layer(tracks), 0, ORIGIN, None, 0.02, lambda a, b: 0.0)
    begins = [tuple(found.points_mm[s]) for s in found.starts[:-1]]
    ends = {tuple(end): k for k, track in enumerate(tracks) for end in (track[0], track[-1])}
    assert [ends[begin] for begin in begins] == nearest_first(tracks, ORIGIN)


def test_of_equally_near_tracks_the_first_one_comes_next():
    square = [np.array([[x, y], [x, y + 0.5]]) for x, y in [(1, 0), (-1, 0), (1, 0), (-1, 0)]]
    found = order_tracks(layer(square), 0, ORIGIN, None, 0.02, lambda a, b: 0.0)
    first = found.points_mm[found.starts[:-1]]
    assert first[0].tolist() == [1, 0]  # number 0, not 1
    assert first[1].tolist() == [1, 0.5]


def test_closed_tracks_go_round_from_where_the_seam_is_wanted():
    turn = np.linspace(0, 2 * np.pi, 41)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ring[-1] = ring[0]
    rng = np.random.default_rng(6)
    tracks = [ring + middle for middle in rng.uniform(0, 200, (80, 2))]
    for direction, backwards in ((0, False), (1, True)):
        found = order_tracks(layer(tracks), direction, ORIGIN, None, 0.02, lambda a, b: 0.0)
        assert len(found.points_mm) == 80 * 41
        for begin, end in zip(found.starts[:-1], found.starts[1:], strict=True):
            x, y = found.points_mm[begin:end].T
            assert (x[0], y[0]) == (x[-1], y[-1])
            area = (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2
            assert (area < 0) == backwards
            assert abs(area) == pytest.approx(np.pi, rel=0.01)
