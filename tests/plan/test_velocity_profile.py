"""Times of moves against closed forms of uniformly accelerated motion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.config.machine import MotionSettings
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.moves import join_moves, moves_of_kind, rounded_to_program_steps
from lmctl.plan.sequence.velocity_profile import line_durations

ORIGIN = np.zeros(3)
MIX = np.array([1.0])


def motion(**changes):
    values = {
        "endpoint": "tcp://127.0.0.1:1", "travel_mm": {"x": (0, 1), "y": (0, 1), "z": (0, 1)},
        "max_speed_mm_s": (100, 100, 100), "acceleration_mm_s2": (500, 500, 500),
        "junction_deviation_mm": 0.01, "planner_blocks": 100, "purge_mm": (0, 0, 0),
    }
    return MotionSettings.model_validate(values | changes)


def path(points, speed=10.0):
    points = np.asarray(points, dtype=float)
    points = np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])
    return moves_of_kind(points, feed_mm_s=speed, kind=LineKind.LEAD, fractions=MIX)


def total(points, speed=10.0, **changes):
    return float(line_durations(path(points, speed), ORIGIN, motion(**changes)).sum())


def test_a_trapezoid_from_rest_to_rest():
    assert total([[20, 0]]) == pytest.approx(20 / 10 + 10 / 500)


def test_a_triangle_where_the_way_is_too_short_for_the_speed():
    assert total([[1, 0]], speed=100) == pytest.approx(2 * np.sqrt(1 / 500))


def test_axes_bound_speed_and_acceleration_along_a_diagonal():
    diagonal = 30 * np.sqrt(2)
    speed, acceleration = 100 * np.sqrt(2), 500 * np.sqrt(2)
    assert total([[30, 30]], speed=1000) == pytest.approx(
        diagonal / speed + speed / acceleration)
    assert total([[20, 0]], speed=10, acceleration_mm_s2=(50, 500, 500)) == pytest.approx(
        2 + 10 / 50)


@pytest.mark.parametrize("degrees", [20, 45, 90, 120])
def test_a_corner_is_passed_at_the_speed_of_the_junction_deviation(degrees):
    turn = np.radians(degrees)
    speed = 40.0
    half_sine = np.sin((np.pi - turn) / 2)
    direction = np.array([np.cos(turn), np.sin(turn)])
    change = (direction - [1, 0]) / np.linalg.norm(direction - [1, 0])
    acceleration = (500 / np.abs(change)).min()
    corner = np.sqrt(acceleration * 0.01 * half_sine / (1 - half_sine))
    second = (500 / np.abs(direction)).min()
    expected = sum(
        20 / speed + speed / (2 * a) + (speed - corner) ** 2 / (2 * a * speed)
        for a in (500, second)
    )
    points = np.array([[20, 0], [20, 0] + 20 * direction])
    assert total(points, speed=speed) == pytest.approx(expected, rel=1e-9)


def test_reversing_is_a_stop():
    assert total([[20, 0], [0, 0]]) == pytest.approx(2 * total([[20, 0]]))


def test_cutting_a_straight_line_in_pieces_takes_no_time():
    whole = total([[30, 0]], speed=50)
    pieces = np.column_stack([np.linspace(0, 30, 61)[1:], np.zeros(60)])
    assert total(pieces, speed=50) == pytest.approx(whole)


@pytest.mark.parametrize("blocks", [4, 15, 100])
def test_the_look_ahead_bounds_the_speed_over_short_segments(blocks):
    """It must be able to stop within the blocks behind the one that runs."""
    segment, count = 0.1, 4000
    points = np.column_stack([segment * np.arange(1, count + 1), np.zeros(count)])
    durations = line_durations(path(points, 100.0), ORIGIN, motion(planner_blocks=blocks))
    speed = segment / durations[count // 2]
    assert speed == pytest.approx(min(100, np.sqrt(2 * 500 * segment * (blocks - 1))), rel=0.05)


def test_a_spiral_of_short_segments_keeps_its_feed():
    """0.1 mm segments at 10 mm/s: neither corners nor the window slow it."""
    turn = np.sqrt(np.linspace(0.5, 60**2, 20_000))
    spiral = np.column_stack([0.2 * turn * np.cos(turn), 0.2 * turn * np.sin(turn)])
    moves = rounded_to_program_steps(path(spiral), ORIGIN)
    length = np.linalg.norm(np.diff(moves.target_mm, axis=0), axis=1).sum()
    taken = line_durations(moves, moves.target_mm[0], motion(planner_blocks=15)).sum()
    assert taken == pytest.approx(length / 10, rel=0.005)


def test_a_dwell_is_reached_and_left_at_rest():
    rest = moves_of_kind([10, 0, 0], feed_mm_s=0, kind=LineKind.DWELL, fractions=MIX, dwell_s=2.5)
    moves = join_moves([path([[10, 0]]), rest, path([[20, 0]])])
    durations = line_durations(moves, ORIGIN, motion())
    assert durations == pytest.approx([1 + 10 / 500, 2.5, 1 + 10 / 500])


def test_setup_takes_no_time():
    moves = join_moves([moves_of_kind(ORIGIN, feed_mm_s=0, kind=LineKind.SETUP, fractions=MIX),
                        path([[5, 0]])])
    assert line_durations(moves, ORIGIN, motion())[0] == 0


points = st.lists(
    st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-5, 5)), min_size=1, max_size=30)


@settings(max_examples=60, deadline=None)
@given(points=points, speed=st.floats(1, 90), blocks=st.integers(4, 20))
def test_no_law_of_motion_is_broken(points, speed, blocks):
    moves = rounded_to_program_steps(path(points, speed), ORIGIN)
    if len(moves) == 0:
        return
    way = np.linalg.norm(np.diff(np.vstack([ORIGIN, moves.target_mm]), axis=0), axis=1)
    durations = line_durations(moves, ORIGIN, motion(planner_blocks=blocks))
    fastest = np.minimum(moves.feed_mm_s, 100 * np.sqrt(3))
    assert (durations >= way / fastest * (1 - 1e-9)).all()
    alone = sum(
        float(line_durations(moves.select(np.array([i])), start, motion())[0])
        for i, start in enumerate(np.vstack([ORIGIN, moves.target_mm[:-1]]))
    )
    assert durations.sum() <= alone * (1 + 1e-9)
    more = line_durations(moves, ORIGIN, motion(planner_blocks=100)).sum()
    assert more <= durations.sum() * (1 + 1e-9)


def test_moves_shorter_than_a_motor_step_are_dropped():
    """The firmware would make no block of them; many in a row still add up to a motion."""
    moves = rounded_to_program_steps(path([[1, 0], [1.0004, 0], [1.0012, 0], [2, 0]]), ORIGIN)
    assert moves.target_mm[:, 0] == pytest.approx([1.0, 2.0])
    creeping = rounded_to_program_steps(path([[1 + 0.005 * i, 0] for i in range(101)]), ORIGIN)
    steps = np.diff(creeping.target_mm[:, 0])
    assert steps.min() >= 0.02 - 1e-9
    assert creeping.target_mm[-1, 0] == pytest.approx(1.5, abs=0.02)
