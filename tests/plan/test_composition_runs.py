"""Quantised composition: multiples of the step, summing to 1, near the field."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lmctl.plan.sequence.composition_runs import (
    composition_knots,
    composition_runs,
    quantised_fractions,
)

mixtures = st.integers(1, 5).flatmap(
    lambda m: hnp.arrays(np.float64, (7, m), elements=st.floats(0.001, 1))
).map(lambda rows: rows / rows.sum(axis=1, keepdims=True))


@settings(max_examples=100, deadline=None)
@given(mixtures, st.sampled_from([0.01, 0.02, 0.03, 0.05, 0.1, 0.5]))
def test_quanta_sum_to_one_and_lie_within_a_quantum(fractions, step):
    result = quantised_fractions(fractions, step)
    quanta = round(1 / step)
    assert result.sum(axis=1) == pytest.approx(np.ones(7), abs=1e-12)
    assert result * quanta == pytest.approx(np.round(result * quanta), abs=1e-9)
    assert np.abs(result - fractions).max() <= 1 / quanta + 1e-9
    assert (result >= 0).all()


def test_two_materials_round_to_the_nearest():
    second = np.array([0.0, 0.009, 0.011, 0.5, 0.9899, 1.0])
    result = quantised_fractions(np.stack([1 - second, second], axis=1), 0.02)
    assert result[:, 1] == pytest.approx([0, 0, 0.02, 0.5, 0.98, 1])


def runs_of_one(second, step=0.02):
    """Bounds and levels of the runs along one track."""
    found = composition_runs(
        np.stack([1 - second, second], axis=1), np.array([0, len(second)]), step)
    return found.bounds, found.levels


def test_a_slope_is_cut_in_runs_centred_on_their_values():
    second = np.linspace(0.2, 0.3, 1001)
    bounds, levels = runs_of_one(second)
    assert levels[:, 1] == pytest.approx([0.2, 0.22, 0.24, 0.26, 0.28, 0.3])
    centres = [second[(a + b) // 2] for a, b in pairwise(bounds[1:-1])]
    assert centres == pytest.approx([0.22, 0.24, 0.26, 0.28], abs=0.003)


def laid(along, second, step=0.02):
    """The mixture laid at each of a track's points."""
    fractions = np.stack([1 - second, second], axis=1)
    starts = np.array([0, len(along)])
    runs = composition_runs(fractions, starts, step)
    at, mixtures, vertices = composition_knots(along, fractions, starts, runs, step)
    assert (np.diff(at) > 0).all()
    assert np.isin(at[1:-1], vertices).all()
    return np.interp(along, at, mixtures[:, 1])


def test_a_jump_is_deposited_between_the_two_points_beside_it():
    along = np.arange(0.0, 60.0, 0.2)
    second = (along > 13.1).astype(float)
    assert laid(along, second) == pytest.approx(second, abs=1e-12)


@settings(max_examples=100, deadline=None)
@given(
    jumps=st.lists(st.tuples(st.floats(0, 30), st.floats(-0.5, 0.5)), max_size=5),
    slope=st.floats(-0.1, 0.1), step=st.sampled_from([0.01, 0.02, 0.1]))
@example(jumps=[(0.0, -0.25), (23.0, 0.094)], slope=0.002, step=0.1)
def test_slopes_and_jumps_are_deposited_within_little_more_than_a_quantum(jumps, slope, step):
    along = np.arange(0.0, 30.0, 0.2)
    second = 0.5 + slope * (along - 15)
    for at, height in jumps:
        second = second + height * (along > at)
    second = np.clip(second, 0, 1)
    assert np.abs(laid(along, second, step) - second).max() <= 1.1 * step + 1e-9


def test_a_jump_within_a_quantum_ends_a_run_too():
    """Else the change to the run's value would reach up to it, from far away."""
    along = np.arange(0.0, 30.0, 0.2)
    second = np.where(along > 23, 0.3556, 0.2 + 0.0027 * along)
    assert np.abs(laid(along, second, 0.1) - second).max() <= 0.6 * 0.1


def test_noise_at_the_edge_of_a_quantum_makes_one_run():
    rng = np.random.default_rng(1)
    second = 0.51 + rng.uniform(-0.002, 0.002, 500)
    _, levels = runs_of_one(second)
    assert len(levels) == 1


def test_a_track_of_one_mixture_has_it_whatever_the_quantum():
    """Half a quantum off was half of the tolerance of a path, for no line less of the program."""
    rng = np.random.default_rng(3)
    second = 0.4712 + rng.uniform(-0.004, 0.004, 500)
    _, levels = runs_of_one(second)
    assert levels[:, 1] == pytest.approx([0.4712], abs=0.0012)


def test_noise_on_a_slope_does_not_flicker():
    rng = np.random.default_rng(1)
    second = np.linspace(0.2, 0.4, 2000) + rng.uniform(-0.001, 0.001, 2000)
    _, levels = runs_of_one(second)
    assert len(levels) == 11


def test_tracks_of_a_layer_are_each_worked_on_alone():
    """Many tracks at once give what each gives by itself, whatever lies beside it."""
    rng = np.random.default_rng(2)
    seconds = [
        np.clip(np.cumsum(rng.normal(0, 0.01, size)) + rng.uniform(0.2, 0.8), 0, 1)
        for size in (2, 40, 5, 300)
    ]
    fields = [np.stack([1 - second, second], axis=1) for second in seconds]
    alongs = [np.arange(len(second)) * 0.2 for second in seconds]
    offsets = np.cumsum([0, *(along[-1] + 1 for along in alongs)])
    starts = np.cumsum([0, *(len(second) for second in seconds)])
    along = np.concatenate([a + o for a, o in zip(alongs, offsets, strict=False)])
    runs = composition_runs(np.vstack(fields), starts, 0.02)
    at, mixtures, _ = composition_knots(along, np.vstack(fields), starts, runs, 0.02)
    together = np.interp(along, at, mixtures[:, 1])
    alone = np.concatenate([laid(a, second) for a, second in zip(alongs, seconds, strict=True)])
    assert together == pytest.approx(alone, abs=1e-12)
