"""The send horizon: enough lines to keep moving, never more motion than allowed, none lost."""

from __future__ import annotations

import random

import pytest

from lmctl.run.program.line_releaser import LineReleaser


def ladder(n, lasting_s=0.1, layers=1):
    return [
        [("bead", (i + 1, 0, k), lasting_s, (k * n + i) // 10) for i in range(n)]
        for k in range(layers)
    ]


def test_exactly_the_horizon_is_released(job):
    streamer = LineReleaser(job(ladder(100)).window(), horizon_s=1.0)
    assert len(streamer.release(0.0, 1.0).lines) == 10
    assert streamer.release(0.0, 1.0).lines == []
    assert len(streamer.release(0.3, 1.0).lines) == 3
    assert streamer.released == 13


def test_the_horizon_is_machine_time(job):
    def released(rate):
        return len(LineReleaser(job(ladder(100)).window(), horizon_s=1.06).release(0.0, rate).lines)

    assert released(0.5) == 5
    assert released(2.0) == 21


def test_the_running_line_and_the_next_always_go(job):
    streamer = LineReleaser(job(ladder(5, lasting_s=30.0, layers=2)).window(), horizon_s=1.0)
    assert len(streamer.release(0.0, 1.0).lines) == 2
    assert len(streamer.release(29.9, 1.0).lines) == 0
    assert len(streamer.release(30.0, 1.0).lines) == 1
    assert len(streamer.release(130.0, 1.0).lines) == 3  # into the next layer
    assert len(streamer.release(290.0, 1.0).lines) == 4


@pytest.mark.parametrize("seed", range(5))
def test_no_line_is_lost_doubled_or_early_over_many_layers(job, seed):
    rng = random.Random(seed)
    small = job(ladder(37, 0.03, layers=9))
    window = small.window()
    streamer = LineReleaser(window, horizon_s=0.5)
    sent, s, begun, completed = [], 0.0, [], []
    rate = rng.choice([0.5, 1.0, 1.4])
    while s < window.end_s:
        batch = streamer.release(s, rate)
        sent += batch.lines
        begun += [p.path for p in batch.begun]
        assert streamer.released == len(sent)
        assert window.line_start_s(len(sent)) - s <= 0.5 * rate + 1e-9
        assert len(sent) > window.line_at_program_time(s)
        s = min(rng.uniform(s, window.line_start_s(len(sent)) + 1e-6), window.end_s)
        completed += [p.path for p in streamer.completed_paths(window.line_at_program_time(s))]
        window.drop_layers_before(window.line_at_program_time(s))
    completed += [p.path for p in streamer.completed_paths(window.n_lines)]
    assert sent == [line.encode() for layer in small.layers for line in layer.program]
    paths = [p.path for k in range(9) for p in small.window().layer_program(k).paths]
    assert begun == completed == paths


def test_a_path_begins_with_its_first_line_and_is_complete_after_its_last(job):
    streamer = LineReleaser(job(ladder(40)).window(), horizon_s=1.0)
    assert [p.path for p in streamer.release(0.0, 1.0).begun] == [0]
    assert streamer.completed_paths(9) == []
    assert [p.path for p in streamer.release(0.95, 1.0).begun] == [1]
    assert [p.path for p in streamer.completed_paths(10)] == [0]
