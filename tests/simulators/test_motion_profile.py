from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulators.motion.speed_profile import braking_profile, fastest_profile

ABOVE_ZERO = st.floats(0.01, 200.0)


def duration(ramps):
    return sum(ramp.duration for ramp in ramps)


def in_order(ramps):
    return list(reversed(ramps))


def test_from_rest_to_rest_is_a_trapezoid():
    ramps = in_order(fastest_profile(0.0, 10.0, 500.0, 20.0, 0.0))
    assert [ramp.exit_speed for ramp in ramps] == [20.0, 20.0, 0.0]
    assert [ramp.distance for ramp in ramps] == pytest.approx([0.4, 9.2, 0.4])
    assert duration(ramps) == pytest.approx(10.0 / 20.0 + 20.0 / 500.0)


def test_too_short_for_the_speed_is_a_triangle():
    ramps = in_order(fastest_profile(0.0, 0.2, 500.0, 20.0, 0.0))
    assert [ramp.exit_speed for ramp in ramps] == pytest.approx([10.0, 0.0])
    assert duration(ramps) == pytest.approx(2 * sqrt(0.2 / 500.0))


def test_at_speed_it_is_one_cruise():
    (ramp,) = fastest_profile(20.0, 3.0, 500.0, 20.0, 400.0)
    assert ramp == (0.0, 0.15, 3.0, 20.0)


def test_above_the_nominal_speed_it_brakes_to_it_first():
    ramps = in_order(fastest_profile(20.0, 10.0, 500.0, 10.0, 0.0))
    assert [ramp.exit_speed for ramp in ramps] == [10.0, 10.0, 0.0]
    assert [ramp.distance for ramp in ramps] == pytest.approx([0.3, 9.6, 0.1])


def test_far_above_the_nominal_speed_it_brakes_all_the_way():
    (ramp,) = fastest_profile(20.0, 0.1, 500.0, 1.0, 0.0)
    assert ramp.exit_speed == pytest.approx(sqrt(400.0 - 100.0))
    assert ramp.acceleration == pytest.approx(-500.0)


def test_braking_ends_in_the_block_or_goes_on_in_the_next():
    (ramp,) = braking_profile(20.0, 1.0, 500.0)
    assert (ramp.exit_speed, ramp.distance) == (0.0, pytest.approx(0.4))
    (ramp,) = braking_profile(20.0, 0.3, 500.0)
    assert (ramp.exit_speed, ramp.distance) == (pytest.approx(10.0), 0.3)


@given(
    speed=st.floats(0.0, 200.0),
    left_mm=st.floats(1e-3, 500.0),
    acceleration=st.floats(1.0, 5000.0),
    nominal=ABOVE_ZERO,
    exit_part=st.floats(0.0, 1.0),
)
def test_covers_the_distance_within_the_limits(speed, left_mm, acceleration, nominal, exit_part):
    exit_sqr = (nominal * exit_part) ** 2
    ramps = in_order(fastest_profile(speed, left_mm, acceleration, nominal, exit_sqr))
    assert sum(ramp.distance for ramp in ramps) == pytest.approx(left_mm, rel=1e-9)
    at = speed
    for ramp in ramps:
        assert ramp.duration > 0.0
        assert abs(ramp.acceleration) <= acceleration * (1 + 1e-6)
        assert ramp.distance == pytest.approx(
            (at + 0.5 * ramp.acceleration * ramp.duration) * ramp.duration, rel=1e-6, abs=1e-9
        )
        at = ramp.exit_speed
        assert at <= max(nominal, speed) * (1 + 1e-9)
    reachable = (
        speed**2 - 2 * acceleration * left_mm <= exit_sqr <= speed**2 + 2 * acceleration * left_mm
    )
    if reachable and speed <= nominal:
        assert at**2 == pytest.approx(exit_sqr, rel=1e-6, abs=1e-6)
