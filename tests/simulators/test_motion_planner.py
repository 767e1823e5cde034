"""Motion in time, against what can be worked out on paper."""

from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.motion.actions import BEAM_CONSTANT, BEAM_DYNAMIC, StraightMove
from simulators.motion.planner import Kinematics, LookAheadPlanner
from simulators.motion.stepper import Stepper
from simulators.motion.trace import MotionTrace

ACCELERATION = 500.0
DEVIATION = 0.01
CELL = Kinematics((250.0,) * 3, (100.0,) * 3, (ACCELERATION,) * 3, DEVIATION)


class Axes:
    """A planner and a stepper on a hand-driven clock, kept full from a list of moves."""

    def __init__(self, moves, blocks=100, lead_s=0.05, lead_blocks=6, kinematics=CELL):
        self.planner = LookAheadPlanner(blocks, kinematics)
        self.trace = MotionTrace((0.0, 0.0, 0.0))
        self.stepper = Stepper(self.planner, self.trace, lead_s, lead_blocks)
        self.moves = list(moves)
        self.now_s = 0.0

    def fill(self):
        while self.moves and self.planner.count < self.planner.capacity:
            self.planner.add(self.moves.pop(0))

    def run(self, until_s=float("inf")):
        """On to until_s, or to the end of all moves."""
        while True:
            self.stepper.advance(self.now_s)
            self.fill()
            if not self.stepper.running and not self.stepper.holding and self.now_s == 0.0:
                self.stepper.start(self.now_s)
            self.stepper.advance(self.now_s)
            due_s = self.stepper.next_event_s()
            if self.stepper.is_stopped(self.now_s) or due_s > until_s:
                break
            assert due_s > self.now_s
            self.now_s = due_s
        if until_s < float("inf"):
            self.now_s = until_s
            self.stepper.advance(until_s)
            self.stepper.commit()
        return self


def line(*target, rate=20.0, **more):
    return StraightMove(target, rate, **more)


def run(*moves, **how):
    return Axes(moves, **how).run()


def speed_at(axes, times_s):
    return axes.trace.sample(times_s).speed_mm_s


def test_a_single_move_takes_distance_over_speed_and_one_ramp():
    axes = run(line(10.0, 0.0, 0.0))
    assert axes.now_s == pytest.approx(10.0 / 20.0 + 20.0 / ACCELERATION, abs=1e-12)
    sample = axes.trace.sample([0.0, 0.02, 0.04, axes.now_s / 2, axes.now_s])
    assert sample.speed_mm_s == pytest.approx([0.0, 10.0, 20.0, 20.0, 0.0])
    assert sample.position_mm[:, 0] == pytest.approx([0.0, 0.1, 0.4, 5.0, 10.0])
    assert sample.block.tolist() == [0, 0, 0, 0, -1]


def test_a_short_move_never_reaches_its_speed():
    axes = run(line(0.2, 0.0, 0.0))
    assert axes.now_s == pytest.approx(2.0 * sqrt(0.2 / ACCELERATION))
    assert speed_at(axes, axes.now_s / 2) == pytest.approx(sqrt(ACCELERATION * 0.2))


def test_a_straight_line_in_pieces_is_as_quick_as_in_one():
    pieces = [line(x / 10.0, 0.0, 0.0) for x in range(1, 101)]
    assert run(*pieces).now_s == pytest.approx(10.0 / 20.0 + 20.0 / ACCELERATION)


@pytest.mark.parametrize("degrees", [15.0, 45.0, 90.0, 120.0, 170.0])
def test_a_corner_is_taken_at_the_junction_deviation_speed(degrees):
    """v² = a δ sin(θ/2) / (1 - sin(θ/2)), θ between the legs, a along the change of direction."""
    turn = degrees * pi / 180.0
    end = (10.0 + 10.0 * cos(turn), 10.0 * sin(turn), 0.0)
    axes = run(line(10.0, 0.0, 0.0, rate=50.0), line(*end, rate=50.0))
    corner = axes.trace.blocks().start_s[1]
    change = np.array([cos(turn) - 1.0, sin(turn)])
    along = ACCELERATION / np.abs(change / np.linalg.norm(change)).max()
    half = sin((pi - turn) / 2.0)
    expected = sqrt(along * DEVIATION * half / (1.0 - half))
    assert speed_at(axes, corner) == pytest.approx(min(expected, 50.0), rel=1e-3)


def test_a_reversal_stops():
    axes = run(line(10.0, 0.0, 0.0), line(0.0, 0.0, 0.0))
    assert speed_at(axes, axes.trace.blocks().start_s[1]) == pytest.approx(0.0, abs=1e-9)


def test_a_gentle_spiral_of_tenths_runs_at_its_speed_with_a_long_buffer():
    turns = [0.1 * k for k in range(1, 1200)]
    spiral = [line(0.4 * t * cos(t / 4), 0.4 * t * sin(t / 4), 0.0) for t in turns]
    axes = run(*spiral, blocks=100)
    blocks = axes.trace.blocks()
    late = blocks.start_s[600:1100]
    assert (speed_at(axes, late) > 19.0).mean() > 0.9


def test_a_short_buffer_limits_the_speed_to_what_it_can_brake():
    """15 blocks of 0.02 mm: no faster than v² = 2 a · 15 · 0.02 mm."""
    moves = [line(0.02 * k, 0.0, 0.0, rate=100.0) for k in range(1, 2001)]
    short, long = run(*moves, blocks=15), run(*moves, blocks=1000)
    top = speed_at(short, np.linspace(0.0, short.now_s, 4000)).max()
    assert 0.9 * sqrt(2 * ACCELERATION * 14 * 0.02) < top <= sqrt(2 * ACCELERATION * 15 * 0.02)
    assert speed_at(long, long.now_s / 2) == pytest.approx(100.0)


def test_each_axis_keeps_its_own_limits():
    kinematics = Kinematics((250.0,) * 3, (100.0, 50.0, 10.0), (500.0, 250.0, 50.0), DEVIATION)
    axes = run(
        line(0.0, 0.0, 20.0, rate=80.0), line(30.0, 40.0, 20.0, rate=80.0), kinematics=kinematics
    )
    phases = axes.trace.phases()
    blocks = axes.trace.blocks()
    delta = blocks.end_mm - blocks.start_mm
    unit = np.abs(delta / np.linalg.norm(delta, axis=1)[:, None])[phases.block]
    top = phases.speed_mm_s + phases.acceleration_mm_s2 * (phases.end_s - phases.start_s)
    assert (top[:, None] * unit <= np.array([100.0, 50.0, 10.0]) * (1 + 1e-9)).all()
    steepest = np.abs(phases.acceleration_mm_s2)[:, None] * unit
    assert (steepest <= np.array([500.0, 250.0, 50.0]) * (1 + 1e-6)).all()
    assert steepest[:, 2].max() == pytest.approx(50.0)


def test_rapids_go_as_fast_as_the_machine_can():
    axes = run(line(100.0, 0.0, 0.0, rapid=True))
    assert speed_at(axes, axes.now_s / 2) == pytest.approx(100.0)


def test_a_move_of_less_than_a_step_is_none():
    axes = run(line(0.0015, 0.0, 0.0))
    assert len(axes.trace.blocks().line) == 0
    assert axes.planner.position_mm == (0.0, 0.0, 0.0)


def test_hold_brakes_along_the_path_from_the_head():
    axes = Axes([line(60.0, 0.0, 0.0)]).run(1.0)
    axes.stepper.brake(axes.now_s)
    axes.run()
    at_1s, braking_mm = 0.4 + (1.0 - 0.04) * 20.0, 20.0**2 / (2 * ACCELERATION)
    stopped = axes.stepper.position_mm(axes.now_s)
    assert stopped[0] == pytest.approx(at_1s + 0.05 * 20.0 + braking_mm)
    assert axes.now_s == pytest.approx(1.0 + 0.05 + 20.0 / ACCELERATION)
    assert not axes.stepper.running


def test_hold_may_span_blocks_and_resume_finishes_the_job():
    moves = [line(0.06 * k, 0.0, 0.0) for k in range(1, 401)]
    axes = Axes(moves).run(0.5)
    axes.stepper.brake(axes.now_s)
    axes.run()
    held_mm = axes.stepper.position_mm(axes.now_s)[0]
    assert speed_at(axes, axes.now_s + 1.0) == 0.0
    assert 0.001 < held_mm % 0.06 < 0.059  # in the middle of a block
    axes.now_s += 10.0
    axes.stepper.start(axes.now_s)
    axes.run()
    assert axes.stepper.position_mm(axes.now_s)[0] == pytest.approx(24.0)
    assert axes.now_s == pytest.approx(10.0 + 24.0 / 20.0 + 2 * 20.0 / ACCELERATION)
    blocks = axes.trace.blocks()
    assert blocks.is_complete.all()
    assert len(blocks.line) == 400


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0])
def test_feed_override_scales_the_speed_in_flight(factor):
    axes = Axes([line(100.0, 0.0, 0.0)]).run(1.0)
    axes.stepper.set_overrides(factor, 1.0, 1.0, axes.now_s)
    axes.run(3.0)
    assert speed_at(axes, [1.049, 2.5]) == pytest.approx([20.0, 20.0 * factor])
    change = axes.trace.phases()
    assert np.abs(change.acceleration_mm_s2).max() == pytest.approx(ACCELERATION)


def test_feed_override_brakes_over_blocks_too_short_for_it():
    axes = Axes([line(0.05 * k, 0.0, 0.0, rate=40.0) for k in range(1, 2001)]).run(0.5)
    axes.stepper.set_overrides(0.1, 1.0, 1.0, axes.now_s)
    axes.run(1.0)
    assert speed_at(axes, 0.9) == pytest.approx(4.0)
    assert np.abs(axes.trace.phases().acceleration_mm_s2).max() <= ACCELERATION * (1 + 1e-6)


def test_rapid_override_leaves_feeds_alone():
    axes = Axes([line(50.0, 0.0, 0.0), line(100.0, 0.0, 0.0, rapid=True)])
    axes.stepper.set_overrides(1.0, 0.25, 1.0, 0.0)
    axes.run()
    blocks = axes.trace.blocks()
    middles = (blocks.start_s + blocks.end_s) / 2
    assert speed_at(axes, middles) == pytest.approx([20.0, 25.0])


def test_power_follows_speed_under_m4_and_not_under_m3():
    m4 = run(line(10.0, 0.0, 0.0, beam=BEAM_DYNAMIC, power=0.5))
    m3 = run(line(10.0, 0.0, 0.0, beam=BEAM_CONSTANT, power=0.5))
    times = np.linspace(0.0, m4.now_s, 501)
    sample = m4.trace.sample(times)
    assert sample.power_fraction == pytest.approx(0.5 * sample.speed_mm_s / 20.0)
    moving = (times > 0.0) & (times < m3.now_s)
    assert m3.trace.sample(times).power_fraction[moving] == pytest.approx(0.5)


def test_under_m4_energy_per_length_survives_a_feed_override():
    axes = Axes([line(100.0, 0.0, 0.0, beam=BEAM_DYNAMIC, power=0.5)]).run(1.0)
    axes.stepper.set_overrides(1.21, 1.0, 0.9, axes.now_s)
    axes.run(2.0)
    sample = axes.trace.sample([1.5])
    assert sample.power_fraction == pytest.approx(0.5 * 1.21 * 0.9)


def test_power_is_never_above_full_nor_below_the_floor():
    axes = Axes([line(20.0, 0.0, 0.0, beam=BEAM_DYNAMIC, power=0.9, floor=0.2)])
    axes.stepper.set_overrides(2.0, 1.0, 1.0, 0.0)
    axes.run()
    power = axes.trace.sample(np.linspace(0.0, axes.now_s, 1001)[1:-1]).power_fraction
    assert (power.min(), power.max()) == (pytest.approx(0.2), 1.0)


def test_stopping_dead_forgets_what_was_committed_ahead():
    axes = Axes([line(0.5 * k, 0.0, 0.0, line=k, beam=2, power=1.0) for k in range(1, 101)])
    axes.run(0.5)
    axes.stepper.stop_immediately(axes.now_s)
    here = axes.planner.position_mm[0]
    assert here == pytest.approx(0.4 + 0.46 * 20.0, abs=0.002)
    sample = axes.trace.sample([0.5, 0.6, 10.0])
    assert sample.speed_mm_s.tolist() == [0.0, 0.0, 0.0]
    assert sample.power_fraction.tolist() == [0.0, 0.0, 0.0]
    blocks = axes.trace.blocks()
    assert blocks.is_complete.tolist() == [True] * (len(blocks.line) - 1) + [False]
    assert blocks.end_mm[-1, 0] == pytest.approx(here, abs=0.002)


def test_outputs_switch_when_their_move_begins():
    axes = run(line(10.0, 0.0, 0.0), line(20.0, 0.0, 0.0, outputs=(("D", 3, 1.0),)))
    ((when, *what),) = axes.trace.outputs
    assert when == pytest.approx(axes.trace.blocks().start_s[1])
    assert what == ["D", 3, 1.0]


def test_the_record_of_a_long_job_stays_small():
    moves = [line(0.05 * (k % 2), 0.05 * k, 0.0) for k in range(1, 3001)]
    axes = run(*moves)
    assert axes.trace.size_bytes / 3000 < 400


MOVES = st.lists(
    st.tuples(
        st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-0.5, 0.5), st.floats(1.0, 90.0)
    ),
    min_size=1,
    max_size=40,
)
DISTURBANCES = st.lists(
    st.tuples(st.floats(0.01, 0.7), st.sampled_from(["hold", "slow", "fast", "usual", "look"])),
    max_size=8,
)


@settings(deadline=None, max_examples=60)
@given(moves=MOVES, disturbances=DISTURBANCES, blocks=st.sampled_from([1, 2, 3, 15, 100]))
def test_whatever_happens_motion_is_continuous_and_within_limits(moves, disturbances, blocks):
    at = np.cumsum([move[:3] for move in moves], axis=0)
    axes = Axes(
        [
            line(*map(float, p), rate=m[3], line=k + 1)
            for k, (p, m) in enumerate(zip(at, moves, strict=True))
        ],
        blocks=blocks,
    )
    for wait_s, what in disturbances:
        axes.run(axes.now_s + wait_s)
        if what == "hold":
            if axes.stepper.running and not axes.stepper.holding:
                axes.stepper.brake(axes.now_s)
                axes.run()
                axes.stepper.start(axes.now_s)
        elif what != "look":
            factor = {"slow": 0.1, "fast": 2.0, "usual": 1.0}[what]
            axes.stepper.set_overrides(factor, 0.5, 1.0, axes.now_s)
    axes.run()

    assert axes.planner.count == 0
    assert axes.trace.position_at(axes.now_s) == pytest.approx(tuple(at[-1]), abs=0.003)
    blocks_done, phases = axes.trace.blocks(), axes.trace.phases()
    assert blocks_done.is_complete.all()
    assert (np.diff(blocks_done.line) >= 1).all()
    gap = phases.start_s[1:] - phases.end_s[:-1]
    assert (gap >= -1e-9).all()
    steepest = np.abs(phases.acceleration_mm_s2).max(initial=0.0)
    assert steepest <= ACCELERATION * sqrt(3) * (1 + 1e-5)
    end = phases.speed_mm_s + phases.acceleration_mm_s2 * (phases.end_s - phases.start_s)
    assert (end > -1e-6).all()
    assert (end <= 180.0).all()
    step = np.abs(phases.speed_mm_s[1:] - end[:-1])
    assert step.max(initial=0.0) < 1e-5  # no jump of the speed, at holds and block ends neither
    assert end[-1:] == pytest.approx(0.0, abs=1e-5)
