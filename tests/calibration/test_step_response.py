"""The chain of lags against closed forms and plain sums."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.calibration.step_response import (
    SetpointHistory,
    displayed_mass_g,
    integrated_step_response,
    nozzle_flow_g_min,
    step_response,
)

X = np.linspace(-1.0, 20.0, 400)
lags = st.floats(0.0, 3.0)


def test_one_lag_is_an_exponential() -> None:
    expected = np.where(X > 0, 1.0 - np.exp(-np.maximum(X, 0) / 1.5), 0.0)
    assert step_response(X, [1.5]) == pytest.approx(expected, abs=1e-12)


def test_two_equal_lags_are_the_limit_of_two_lags() -> None:
    x = np.maximum(X, 0.0)
    expected = 1.0 - (1.0 + x) * np.exp(-x)
    assert step_response(X, [1.0, 1.0]) == pytest.approx(expected, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(lags, lags, lags)
def test_a_chain_rises_from_0_to_1_and_delays_by_the_sum_of_its_lags(
    a: float, b: float, c: float
) -> None:
    rise = step_response(X, [a, b, c])
    assert np.all(np.diff(rise) > -1e-6)
    assert rise[0] == 0.0
    late_s = 300.0
    mean_delay_s = late_s - float(integrated_step_response(np.array([late_s]), [a, b, c])[0])
    assert mean_delay_s == pytest.approx(a + b + c, abs=0.02)


def test_the_integral_is_the_integral() -> None:
    x = np.linspace(0.0, 10.0, 20_001)
    h = step_response(x, [0.5, 1.3])
    summed = np.concatenate([[0.0], np.cumsum((h[1:] + h[:-1]) / 2) * (x[1] - x[0])])
    assert integrated_step_response(x, [0.5, 1.3]) == pytest.approx(summed, abs=1e-6)


def test_mass_grows_by_the_flow() -> None:
    history = SetpointHistory(np.array([-50.0, 5.0, 9.0]), np.array([1.0, 8.0, 2.0]))
    way = {"dead_time_s": 2.0, "lags_s": (0.7, 0.2), "slope": 1.1, "offset_g_min": 0.3}
    time_s = np.linspace(0.0, 30.0, 6001)
    flow = nozzle_flow_g_min(time_s, history, **way) / 60.0
    grown = np.concatenate([[0.0], np.cumsum((flow[1:] + flow[:-1]) / 2) * 0.005])
    assert displayed_mass_g(time_s, history, **way) == pytest.approx(grown, abs=1e-4)
    assert flow[0] * 60 == pytest.approx(1.4)
    assert flow[-1] * 60 == pytest.approx(2.5, abs=1e-6)


def test_a_history_runs_forward() -> None:
    with pytest.raises(ValueError, match="a time for each level"):
        SetpointHistory(np.array([1.0, 2.0]), np.array([1.0]))
    with pytest.raises(ValueError, match="must rise"):
        SetpointHistory(np.array([1.0, 1.0]), np.array([1.0, 2.0]))
