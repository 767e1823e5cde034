"""Ramps of the mixture against a fine numerical integration of the hose."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from lmctl.plan.sequence.mixture_ramps import (
    MIN_RAMP_S,
    SETTLED_FRACTION,
    PowderLimits,
    needed_before_beads_s,
)
from lmctl.plan.sequence.mixture_ramps import min_ramp_duration_s as needed_times_s
from lmctl.plan.sequence.mixture_ramps import ramp_knots as ramp_course
from lmctl.plan.sequence.powder_flow import followed_flow

#: Volume flow in units of the whole, so that flows are volume fractions.
UNIT = PowderLimits(np.array([1.0, 1.0]), np.array([4.0, 4.0]), np.ones(2))


def needed_s(start, end, limits, step):
    return float(needed_times_s(start[None], end[None], limits, step)[0])


def ramp(start, end, gap_s, limits):
    return ramp_course(start, end, gap_s, limits.lag_s, limits.max_flow_g_s)


def followed(times, wanted, start, limits):
    flow = followed_flow(times, wanted, start, limits)
    return flow.times_s, flow.g_s


def mix(second):
    return np.array([1 - second, second])


def integrated(times, wanted, lag, limit, ask):
    """Flow at the nozzle, in steps of 0.1 ms; set-points lead by the lag, within their bounds."""
    step = 1e-4
    t = np.arange(times[0], times[-1] + step, step)
    w = np.interp(t, times, wanted)
    slope = (np.interp(t + step, times, wanted) - w) / step
    u = np.clip(w + lag * slope, 0, limit)
    share = step / lag
    y, _ = lfilter([0.0, share], [1.0, share - 1.0], u, zi=[wanted[0]])
    return np.interp(ask, t, y)


@pytest.mark.parametrize(
    ("start", "end"), [(0.2, 0.3), (0.3, 0.2), (0.5, 0.9), (0.9, 0.1), (0.0, 0.4), (0.05, 0.95)])
def test_a_ramp_that_is_given_its_time_arrives(start, end):
    """What the nozzle lays at the gap's end is the new mixture, bounds and all."""
    a, b = mix(start), mix(end)
    gap = needed_s(a, b, UNIT, 0.02)
    arrival = laid_after(a, b, gap, 0.0)
    assert np.abs(arrival - b).max() <= 0.02


@pytest.mark.parametrize(("start", "end"), [(0.1, 0.0), (0.9, 1.0), (0.5, 0.0), (0.3, 1.0)])
def test_a_hopper_that_stops_needs_its_hose_to_empty(start, end):
    """A lag needs τ ln(a/b) down to a rest b; here b is what may still be missing."""
    a, b = mix(start), mix(end)
    falling = max(a[0] - b[0], a[1] - b[1])
    gap = needed_s(a, b, UNIT, 0.02)
    assert gap == pytest.approx(np.log(falling / SETTLED_FRACTION), rel=0.15)
    assert np.abs(laid_after(a, b, gap, 0.0) - b).max() <= 0.02
    assert np.abs(laid_after(a, b, gap, 2.0) - b).max() <= 0.005


def laid_after(a, b, gap, later):
    """Volume fractions at the nozzle `later` after a gap with the planned ramp in it."""
    course, share = ramp(a, b, gap, UNIT)
    times = np.concatenate([[-1.0], course, [course[-1] + 10]])
    flow = np.vstack([a, a + share[:, None] * (b - a), b])
    if course[0] == 0:
        times[0] = -0.5
    laid = np.array([
        integrated(times, flow[:, k], UNIT.lag_s[k], UNIT.max_flow_g_s[k], gap + later)
        for k in range(2)])
    return laid / laid.sum()


def test_what_hoppers_can_follow_is_followed():
    times = np.array([0.0, 1, 3, 4])
    wanted = np.array([mix(0.5), mix(0.6), mix(0.3), mix(0.3)])
    at, flow = followed(times, wanted, wanted[0], UNIT)
    assert at.tolist() == times.tolist()
    assert flow == pytest.approx(wanted)


def test_a_jump_under_a_beam_that_is_on_takes_the_hose_its_time():
    """To 98 % in 3.91 τ, at an even volume, set-points within their bounds."""
    times = np.array([0.0, 1, 1.02, 12])
    wanted = np.array([mix(0), mix(0), mix(1), mix(1)])
    at, flow = followed(times, wanted, wanted[0], UNIT)
    assert flow.sum(axis=1) == pytest.approx(np.ones(len(at)))
    assert np.interp(0.98, flow[:, 1], at) - 1 == pytest.approx(3.91, rel=0.05)
    assert flow[-1] == pytest.approx(mix(1), abs=1e-3)
    slope = np.diff(flow, axis=0) / np.diff(at)[:, None]
    for setpoint in (flow[:-1] + slope, flow[1:] + slope):  # τ is 1 s
        assert ((setpoint >= -1e-9) & (setpoint <= UNIT.max_flow_g_s + 1e-9)).all()


@settings(max_examples=80, deadline=None)
@given(start=st.floats(0, 1), end=st.floats(0, 1), gap=st.floats(0.01, 20))
def test_a_course_is_a_course(start, end, gap):
    times, share = ramp(mix(start), mix(end), gap, UNIT)
    assert times[0] >= 0
    assert (np.diff(times) >= 0).all()
    assert (np.diff(share) > 0).all()
    assert share[0] == 0
    assert share[-1] == 1


def test_total_volume_is_even_along_a_ramp():
    times, share = ramp(mix(0.9), mix(0.0), 5.0, UNIT)
    flow = mix(0.9) + share[:, None] * (mix(0.0) - mix(0.9))
    assert flow.sum(axis=1) == pytest.approx(np.ones(len(times)))


def test_a_short_straight_ramp_lies_in_the_middle_of_a_long_gap():
    """So that an error of the dead time of a quarter of the gap does not reach a bead."""
    times, _ = ramp(mix(0.4), mix(0.5), 4.0, UNIT)
    assert times == pytest.approx([1.0, 3.0])


def test_changes_within_a_quantum_need_no_time():
    assert needed_s(mix(0.50), mix(0.52), UNIT, 0.02) == 0
    assert needed_s(mix(0.50), mix(0.54), UNIT, 0.02) >= MIN_RAMP_S
    assert needed_s(mix(0.5), mix(0.5), UNIT, 0.02) == 0


def test_time_needed_is_that_of_the_slowest_hose():
    quick = PowderLimits(np.array([0.5, 0.5]), np.full(2, 4.0), np.ones(2))
    one_slow = PowderLimits(np.array([0.5, 3.0]), np.full(2, 4.0), np.ones(2))
    assert needed_s(mix(0.9), mix(0.2), one_slow, 0.02) > 3 * needed_s(
        mix(0.9), mix(0.2), quick, 0.02)


@pytest.mark.parametrize("gap_s", [2.5, 4.0])
@pytest.mark.parametrize("end", [0.2, 0.6])
def test_a_change_keeps_clear_of_both_beads_where_there_is_time(gap_s, end):
    times, share = ramp_course(mix(0.4), mix(end), gap_s, UNIT.lag_s, UNIT.max_flow_g_s, 0.5)
    assert times[0] >= 0.5 - 1e-9
    assert times[-1] <= gap_s - 0.5 + 1e-9
    assert (np.diff(share) > 0).all()
    assert share[[0, -1]].tolist() == [0, 1]


def test_with_a_margin_small_changes_need_time_too():
    start, end = np.array([mix(0.30)]), np.array([mix(0.31)])
    assert needed_before_beads_s(start, end, UNIT, 0.02, 0.0) == pytest.approx([0.0])
    assert needed_before_beads_s(start, end, UNIT, 0.02, 0.5) == pytest.approx([1.25], abs=0.01)
    assert needed_before_beads_s(start, start, UNIT, 0.02, 0.5) == pytest.approx([0.0])
