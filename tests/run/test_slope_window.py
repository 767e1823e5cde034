"""Loss in weight against commanded mass: what a window says, and what a slow integrator does."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.config.measuring import FeederCorrectionSettings
from lmctl.run.powder.slope_window import (
    SlopeCorrection,
    SlopeDrift,
    SlopeMeasurement,
    SlopeWindow,
)


def fed_through(window: SlopeWindow, slope: float, flow_g_min: float, seconds: float):
    """Readings every 4 s of a hopper that weighs to 0.1 g; the measurements made of them."""
    found = []
    for n in range(int(seconds / 4) + 1):
        fed_g = flow_g_min * n * 4.0 / 60.0
        one = window.add(4.0 * n, round(800.0 - slope * fed_g, 1), fed_g)
        found += [one] if one is not None else []
    return found


def test_a_window_shows_the_slope_to_better_than_a_per_cent_in_three_minutes() -> None:
    (found,) = fed_through(SlopeWindow(180.0), 1.04, 10.0, 190.0)
    assert found.ratio == pytest.approx(1.04, abs=3 * found.standard_error)
    assert found.standard_error < 0.01
    assert found.to_s - found.from_s == 180.0


def test_a_slow_hopper_takes_a_longer_window_and_a_still_one_none() -> None:
    slow = fed_through(SlopeWindow(60.0), 1.0, 1.5, 900.0)
    assert all(one.to_s - one.from_s > 60.0 for one in slow)
    assert fed_through(SlopeWindow(60.0), 1.0, 0.0, 900.0) == []


def test_a_restart_forgets_what_was_collected() -> None:
    window = SlopeWindow(120.0)
    fed_through(window, 1.0, 10.0, 100.0)
    window.restart()
    assert window.add(104.0, 500.0, 20.0) is None  # refilled meanwhile: no jump is seen
    assert window.add(228.0, 479.3, 40.7) is None  # two readings are no window


def measured(ratio: float) -> SlopeMeasurement:
    return SlopeMeasurement(ratio, 0.002, 0.0, 120.0, 20.0)


def test_the_integrator_has_its_time_constant() -> None:
    correction = SlopeCorrection(FeederCorrectionSettings(time_constant_windows=10))
    true_slope, windows = 1.05, 10
    for _ in range(windows):
        correction.take(measured(true_slope / correction.value))
    assert correction.value == pytest.approx(1.05 - 0.05 * math.exp(-1.0), abs=0.002)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.2, 5.0), min_size=1, max_size=60))
def test_no_measurement_takes_it_beyond_ten_per_cent(ratios: list[float]) -> None:
    correction = SlopeCorrection(FeederCorrectionSettings())
    for ratio in ratios:
        assert 0.9 <= correction.take(measured(ratio)) <= 1.1
        assert correction.is_at_limit == (correction.value in (0.9, 1.1))


def test_drift_is_a_line_through_windows() -> None:
    drift = SlopeDrift()
    found = [drift.add(120.0 * n, 1.0 + 0.02 * 120.0 * n / 3600.0) for n in range(10)]
    assert found[:2] == [None, None]
    assert found[-1] == pytest.approx(0.02)
