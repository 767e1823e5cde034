"""The window over a job: times, flows and lines as the job has them, and only a few layers held."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def there_and_back(layers=3):
    """Each layer: 1 s of travel, then two beads of 2 s, then a dwell of 1 s: 6 s."""
    return [
        [
            ("travel", (10, 0, k), 1.0),
            ("bead", (30, 0, k), 2.0, 2 * k),
            ("bead", (50, 0, k), 2.0, 2 * k + 1),
            ("dwell", (50, 0, k), 1.0),
        ]
        for k in range(layers)
    ]


def test_lines_know_where_and_when_they_start_across_layers(job):
    window = job(there_and_back()).window()
    assert window.n_lines == 12
    assert window.end_s == 18.0
    assert [window.line_start_s(line) for line in range(13)] == [
        0, 1, 3, 5, 6, 7, 9, 11, 12, 13, 15, 17, 18
    ]
    assert window.layer_program(1).start_mm[0].tolist() == [50, 0, 0]
    assert window.layer_program_of_line(4).index == 1


def test_paths_are_found_with_their_lines(job):
    window = job(there_and_back()).window()
    spans = [(p.path, p.first_line,
              p.last_line) for k in range(3) for p in window.layer_program(k).paths]
    assert spans == [(0, 1, 1), (1, 2, 2), (2, 5, 5), (3, 6, 6), (4, 9, 9), (5, 10, 10)]
    assert [p.path for p in window.layer_program(1).paths_from(6, 8)] == [3]


def test_flow_is_linear_between_knots_and_constant_outside(job):
    knots = [(0.0, (1.0, 0.0)), (6.0, (0.0, 2.0)), (8.0, (0.0, 0.0)), (18.0, (1.0, 1.0))]
    window = job(there_and_back(), flow=knots).window()
    def flows(s):
        return [window.flow_g_s(hopper, s) for hopper in range(2)]

    assert flows(-5.0) == [1.0, 0.0]
    assert flows(3.0) == pytest.approx([0.5, 1.0])
    assert flows(6.0) == pytest.approx([0.0, 2.0])
    assert flows(7.0) == pytest.approx([0.0, 1.0])
    assert flows(13.0) == pytest.approx([0.5, 0.5])
    assert flows(99.0) == [1.0, 1.0]


def test_an_override_scales_feed_and_neither_rapids_nor_dwells(job):
    window = job(there_and_back()).window()
    # From 0.5: 0.5 s of travel as planned, then 4 s of beads at half speed take 8 s, then dwell.
    assert window.advance(0.5, 0.25, 0.5) == pytest.approx(0.75)
    assert window.advance(0.5, 0.5 + 2.0, 0.5) == pytest.approx(2.0)
    assert window.advance(0.5, 0.5 + 8.0 + 0.5, 0.5) == pytest.approx(5.5)
    # Into the next layer: its travel, then a bead.
    assert window.advance(5.5, 0.5 + 1.0 + 1.0, 0.5) == pytest.approx(7.5)
    assert window.advance(1.0, 1.0, 2.0) == pytest.approx(3.0)
    assert window.advance(0.0, 1e6, 0.5) == window.end_s
    assert window.advance(17.9, 1e6, 1.0) == window.end_s
    assert window.advance(3.0, -1.0, 0.5) == 3.0


@settings(max_examples=200, deadline=None)
@given(
    s=st.floats(0, 18), first_s=st.floats(0, 20), second_s=st.floats(0, 20),
    rate=st.floats(0.1, 2.0),
)
def test_advancing_twice_is_advancing_by_the_sum(job, s, first_s, second_s, rate):
    window = job(there_and_back()).window()
    twice = window.advance(window.advance(s, first_s, rate), second_s, rate)
    assert twice == pytest.approx(window.advance(s, first_s + second_s, rate), abs=1e-9)
    assert s - 1e-9 <= window.advance(s, first_s, rate) <= window.end_s


def test_only_layers_near_the_run_are_held(job):
    small = job(there_and_back(layers=50))
    read = []

    class Counting:
        def __getitem__(self, index):
            read.append(index)
            return small.layers[index]

    window = type(small.window())(small.manifest, Counting().__getitem__, (0, 0, 0))
    for line in range(0, window.n_lines, 2):
        window.drop_layers_before(line)
        window.flow_g_s(0, min(window.line_start_s(line) + 8.0, window.end_s))
        assert window.layer_program_of_line(line).first_line <= line
        assert len(window._loaded) <= 4
    assert read == list(range(50))  # each once, in order
    with pytest.raises(IndexError):
        window.layer_program(3)


def test_fed_time_carries_over_forgotten_layers(job):
    window = job(there_and_back(layers=4)).window()
    window.layer_program(3)
    before = window.advance(19.0, 2.0, 0.5)
    window.drop_layers_before(12)
    assert window.advance(19.0, 2.0, 0.5) == before == pytest.approx(20.0)


def test_with_the_beam_off_no_line_asks_for_power(job):
    window = job(there_and_back(1)).window(beam_off=True)
    assert b"S500" not in b"".join(window.layer_program(0).program)
    assert np.array(window.layer_program(0).program).size == 4
    assert not any(window.commanded_between(0.0, 6.0)[1])


def test_the_next_beam_off_span_is_found_across_beads_and_layers(job):
    window = job(there_and_back()).window()  # dark: 0-1, 5-6 and on into 6-7, 11-12, ...
    assert window.next_beam_off_span_s(0.0, 60.0) == (0.0, 1.0)
    assert window.next_beam_off_span_s(0.5, 60.0) == (5.0, 6.0)
    assert window.next_beam_off_span_s(5.5, 60.0) == (6.0, 7.0)
    assert window.next_beam_off_span_s(7.0, 60.0) == (11.0, 12.0)
    assert window.next_beam_off_span_s(7.0, 11.0) is None
    assert window.next_beam_off_span_s(17.5, 60.0) is None


def test_machine_time_is_what_advancing_takes(job):
    window = job(there_and_back()).window()
    for rate in (0.5, 1.0, 1.7):
        taken_s = window.machine_time_s(13.3, rate) - window.machine_time_s(2.2, rate)
        assert window.advance(2.2, taken_s, rate) == pytest.approx(13.3)
