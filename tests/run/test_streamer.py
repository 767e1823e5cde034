"""The send horizon: enough lines to keep moving, never more motion than allowed, none lost."""

from __future__ import annotations

import random

import pytest

from lmctl.run.streamer import Streamer


def ladder(n, lasting_s=0.1, layers=1):
    return [
        [("bead", (i + 1, 0, k), lasting_s, (k * n + i) // 10) for i in range(n)]
        for k in range(layers)
    ]


def test_exactly_the_horizon_is_released(job):
    streamer = Streamer(job(ladder(100)).window(), horizon_s=1.0)
    assert len(streamer.take(0, 1.0).lines) == 10
    assert streamer.take(0, 1.0).lines == []
    assert len(streamer.take(3, 1.0).lines) == 3
    assert streamer.released == 13


def test_slower_motion_fills_the_horizon_with_fewer_lines(job):
    streamer = Streamer(job(ladder(100)).window(), horizon_s=1.0)
    assert len(streamer.take(0, 0.5).lines) == 5
    assert len(Streamer(job(ladder(100)).window(), 1.0).take(0, 2.0).lines) == 10


def test_the_running_line_and_the_next_always_go(job):
    streamer = Streamer(job(ladder(10, lasting_s=30.0)).window(), horizon_s=1.0)
    assert len(streamer.take(0, 1.0).lines) == 2
    assert len(streamer.take(1, 1.0).lines) == 1
    assert len(streamer.take(9, 1.0).lines) == 7


@pytest.mark.parametrize("seed", range(5))
def test_no_line_is_lost_doubled_or_early_over_many_layers(job, seed):
    rng = random.Random(seed)
    small = job(ladder(37, 0.03, layers=9))
    window = small.window()
    streamer = Streamer(window, horizon_s=0.5)
    sent, executed, begun, completed = [], 0, [], []
    while executed < window.n_lines:
        batch = streamer.take(executed, rng.choice([0.5, 1.0, 1.4]))
        sent += batch.lines
        begun += [p.path for p in batch.begun]
        assert streamer.released == len(sent)
        on_controller_s = window.line_start_s(len(sent)) - window.line_start_s(executed)
        assert on_controller_s <= 0.5 + 1e-9
        assert len(sent) > executed
        executed = rng.randint(executed, len(sent))
        completed += [p.path for p in streamer.completed(executed)]
        window.forget(executed)
    assert sent == [line.encode() for layer in small.layers for line in layer.program]
    paths = [p.path for k in range(9) for p in small.window().stretch(k).paths]
    assert begun == completed == paths


def test_a_path_begins_with_its_first_line_and_is_complete_after_its_last(job):
    streamer = Streamer(job(ladder(40)).window(), horizon_s=1.0)
    assert [p.path for p in streamer.take(0, 1.0).begun] == [0]
    assert streamer.completed(9) == []
    assert [p.path for p in streamer.take(9, 1.0).begun] == [1]
    assert [p.path for p in streamer.completed(10)] == [0]
