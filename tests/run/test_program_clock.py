"""The program clock against motion whose true program time is known."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.run.program.program_clock import ProgramClock

POLL_S = 0.1


def zigzag(n=40, lasting_s=0.25, speed_mm_s=10.0):
    """A layer of lines that turn at right angles, so that positions tell them apart."""
    x = y = 0.0
    rows = []
    for i in range(n):
        x, y = (x + speed_mm_s * lasting_s, y) if i % 2 else (x, y + speed_mm_s * lasting_s)
        rows.append(("bead", (x, y, 0), lasting_s, 0))
    return [rows]


def place(window, s):
    """Executed lines and position of a machine that moves as planned, at program time s."""
    line = 0
    while line < window.n_lines and window.line_start_s(line + 1) <= s:
        line += 1
    if line == window.n_lines:
        return line, tuple(window.layer_program(0).end_mm[-1])
    stretch = window.layer_program_of_line(line)
    row = line - stretch.first_line
    share = (s - stretch.start_s[row]) / (stretch.end_s[row] - stretch.start_s[row])
    at = stretch.start_mm[row] + share * (stretch.end_mm[row] - stretch.start_mm[row])
    return line, tuple(np.round(at, 3))


def test_it_stands_until_motion_starts_and_follows_reports(job):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    assert clock.program_time_s(5.0) == 0.0
    assert clock.program_time_ahead_s(5.0, 3.0) == 0.0
    clock.start_at(7.0)
    assert clock.program_time_s(6.0) == 0.0
    # it will have run for 2 s by then
    assert clock.program_time_ahead_s(6.0, 3.0) == pytest.approx(2.0)
    assert clock.program_time_s(8.5) == pytest.approx(1.5)
    clock.on_report(8.5, *place(window, 1.45))
    assert clock.program_time_s(8.5) == pytest.approx(1.45, abs=1e-3)
    assert clock.program_time_s(9.5) == pytest.approx(2.45, abs=1e-3)


@pytest.mark.parametrize("speed", [0.8, 1.0, 1.25])
def test_a_machine_faster_or_slower_than_planned_is_followed(job, speed):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    worst = 0.0
    for k in range(1, 75):
        t = k * POLL_S
        worst = max(worst, abs(clock.program_time_s(t - 1e-6) - speed * t))
        clock.on_report(t, *place(window, speed * t))
        assert clock.program_time_s(t) == pytest.approx(speed * t, abs=1e-3)
    assert worst < 0.03


def test_a_line_with_acceleration_is_followed_within_30_ms(job):
    """Every line starts and ends at rest: the worst a planned line can be for its even clock."""
    lasting_s, length_mm = 0.25, 2.5
    window = job(zigzag(lasting_s=lasting_s)).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    worst, errors = 0.0, []
    for k in range(1, 90):
        t = k * POLL_S + 0.013
        line = int(t // lasting_s)
        u = t / lasting_s - line
        share = 2 * u * u if u < 0.5 else 1 - 2 * (1 - u) ** 2
        start = window.layer_program(0).start_mm[line]
        way = window.layer_program(0).end_mm[line] - start
        assert np.linalg.norm(way) == pytest.approx(length_mm)
        clock.on_report(t, line, tuple(start + share * way))
        errors.append(abs(clock.program_time_s(t) - t))
        worst = max(worst, errors[-1])
    assert worst < 0.04
    assert np.mean(errors) < 0.025


def test_time_never_runs_past_what_the_controller_has_taken(job):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(4)
    clock.start_at(0.0)
    assert clock.program_time_s(0.9) == pytest.approx(0.9)
    assert clock.program_time_s(3.0) == pytest.approx(1.0)
    clock.acknowledge(6)
    assert clock.program_time_s(3.0) == pytest.approx(1.5)


def test_a_hold_stops_it_where_the_machine_stopped(job):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    clock.stop_at(1.0)
    clock.on_report(1.1, *place(window, 1.04))
    assert clock.program_time_s(30.0) == pytest.approx(1.04, abs=1e-3)
    assert clock.program_time_ahead_s(30.0, 3.0) == clock.program_time_s(30.0)
    clock.start_at(42.0)
    assert clock.program_time_ahead_s(40.0, 3.0) == pytest.approx(2.04, abs=1e-3)
    assert clock.program_time_s(41.0) == pytest.approx(1.04, abs=1e-3)
    assert clock.program_time_s(43.0) == pytest.approx(2.04, abs=1e-3)


def test_an_override_changes_the_rate_from_then_on(job):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    clock.set_override(2.0, 0.6)
    assert clock.program_time_s(2.0) == pytest.approx(2.0)
    assert clock.program_time_s(4.0) == pytest.approx(3.2)
    assert clock.program_time_ahead_s(4.0, 1.0) == pytest.approx(3.8)


@pytest.mark.parametrize("off", [-20, 0, 6])
def test_a_coarse_count_of_executed_lines_is_corrected_by_position(job, off):
    """Planner blocks (Bf) tell the line only roughly; short lines, over a change of layer."""
    rows = [("bead", (0.1 * i, 0.02 * (i % 3), 0), 0.01, 0) for i in range(1, 300)]
    window = job([rows[:150], rows[150:]]).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    for k in range(1, 25):
        s = k * POLL_S
        executed, at = place(window, s)
        clock.on_report(s, max(executed + off, 0), at)
        assert clock.program_time_s(s) == pytest.approx(s, abs=2e-3)


def test_a_path_that_retraces_itself_is_distinguished_by_time(job):
    rows = []
    for _ in range(10):
        rows += [("bead", (1, 0, 0), 0.05, 0), ("bead", (0, 0, 0), 0.05, 0)]
    window = job([rows]).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    for k in range(1, 9):
        s = k * POLL_S + 0.017
        clock.on_report(s, *place(window, s))
        assert clock.program_time_s(s) == pytest.approx(s, abs=2e-3)


def test_in_a_dwell_time_runs_on_though_the_position_stands(job):
    window = job([[("travel", (10, 0, 0), 0.2), ("dwell", (10, 0, 0), 5.0),
                   ("bead", (20, 0, 0), 1.0, 0)]]).window()
    clock = ProgramClock(window)
    clock.acknowledge(3)
    clock.start_at(0.0)
    for k in range(3, 52):
        clock.on_report(k * POLL_S, 1, (10.0, 0.0, 0.0))
    assert clock.program_time_s(5.1) == pytest.approx(5.1)


def test_the_end_is_the_end(job):
    window = job(zigzag(4)).window()
    clock = ProgramClock(window)
    clock.acknowledge(4)
    clock.start_at(0.0)
    clock.on_report(0.9, 4, place(window, 1.0)[1])
    assert clock.program_time_s(0.9) == 1.0
    assert clock.program_time_s(9.0) == 1.0


def test_a_planned_override_is_counted_with_before_it_comes(job):
    """Beads to 4 s, a rapid to 5 s, beads again: half speed from the rapid on."""
    rows = [("bead", (10, 0, 0), 4.0, 0), ("travel", (0, 5, 0), 1.0), ("bead", (10, 5, 0), 5.0, 1)]
    window = job([rows]).window()
    clock = ProgramClock(window)
    clock.acknowledge(3)
    clock.start_at(0.0)
    clock.schedule_override(4.0, 5.0, 0.5)
    assert clock.program_time_ahead_s(1.0, 2.0) == pytest.approx(3.0)
    assert clock.program_time_ahead_s(1.0, 4.0) == pytest.approx(5.0)  # the rapid keeps its speed
    assert clock.program_time_ahead_s(1.0, 6.0) == pytest.approx(6.0)
    assert [clock.override_at(s) for s in (3.9, 4.5, 5.0, 9.0)] == pytest.approx([1.0, 0.75, 0.5,
                                                                                  0.5])
    assert clock.due_override(3.9) is None
    assert clock.due_override(4.05) == 0.5
    clock.set_override(4.05, 0.5)
    assert clock.due_override(4.1) is None
    assert clock.program_time_ahead_s(4.05, 1.95) == pytest.approx(5.5)
    clock.on_report(6.05, 2, (1.0, 5.0, 0.0))
    clock.on_report(6.1, 2, (1.1, 5.0, 0.0))
    assert clock.override_at(4.5) == 0.5  # long past, and forgotten


def test_a_planned_override_is_due_until_it_has_been_set(job):
    """However late the report in which it is looked for."""
    window = job([[("bead", (10, 0, 0), 4.0, 0), ("travel", (0, 5, 0), 0.1),
                   ("bead", (10, 5, 0), 5.0, 1)]]).window()
    clock = ProgramClock(window)
    clock.acknowledge(3)
    clock.start_at(0.0)
    clock.schedule_override(4.0, 4.1, 0.5)
    assert clock.override_due_in_s(3.0) == pytest.approx(1.0)
    assert not clock.is_override_pending_before(4.0)
    assert clock.is_override_pending_before(4.5)
    clock.on_report(4.5, 2, (0.8, 5.0, 0.0))
    assert clock.due_override(4.5) == 0.5
    clock.set_override(4.5, 0.5)
    assert not clock.is_override_pending_before(4.5)
    clock.on_report(4.6, 2, (0.9, 5.0, 0.0))
    assert not clock.is_override_pending


def test_an_override_turned_at_the_panel_counts_until_the_planned_one(job):
    window = job(zigzag()).window()
    clock = ProgramClock(window)
    clock.acknowledge(window.n_lines)
    clock.start_at(0.0)
    clock.schedule_override(4.0, 4.5, 0.5)
    clock.set_override(1.0, 0.8)
    assert [clock.override_at(s) for s in (1.0, 3.9, 4.25, 5.0)] == pytest.approx([0.8, 0.8, 0.65,
                                                                                   0.5])
    clock.cancel_scheduled_override()
    assert clock.override_at(5.0) == 0.8
