"""The estimators: right on the average, and as sure as they have a right to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lmctl.calibration.estimate import Estimate
from lmctl.calibration.flow_noise import FlowNoise, IncrementWhitener
from lmctl.calibration.step_fit import fit_feeder_response, fit_scale_lag
from tests.calibration.synthetic_steps import STEP_S, lagged, weighed_steps

SCALE_LAG = Estimate(0.3, 0.003)
SEEDS = 12


def test_whitened_noise_has_variance_one_and_no_memory() -> None:
    random = np.random.default_rng(7)
    keep, rsd, flow = np.exp(-STEP_S), 0.05, 0.3137
    noise = [random.standard_normal()]
    for _ in range(60_000):
        noise.append(keep * noise[-1] + np.sqrt(1 - keep**2) * random.standard_normal())
    mass = np.cumsum(flow * (1.0 + rsd * np.array(noise))) * STEP_S
    shown = np.round(lagged(mass, 0.3)[::10], 2)
    time_s = STEP_S * 10 * np.arange(len(shown))
    whitener = IncrementWhitener(time_s, np.full(len(shown) - 1, flow),
                                 FlowNoise(rsd, 1.0, 0.3, 0.01 / 12**0.5))
    white = whitener.whiten(np.diff(shown) - flow * np.diff(time_s))[50:]
    assert np.var(white) == pytest.approx(1.0, abs=0.06)
    for lag in (1, 2, 5, 20):
        assert abs(float(np.mean(white[lag:] * white[:-lag]))) < 0.05


def test_intervals_cover_the_truth_as_often_as_they_claim() -> None:
    """95 % intervals of 12 tests and three values: at least 31 of 36, and not far too wide."""
    covered, errors = 0, []
    for seed in range(SEEDS):
        fit = fit_feeder_response(weighed_steps(seed), SCALE_LAG).one_lag
        for estimate, truth in ((fit.dead_time_s, 3.3), (fit.lag_s, 1.2), (fit.slope, 1.05)):
            low, high = estimate.interval
            covered += low <= truth <= high
            errors.append((estimate.value - truth) / estimate.standard_error)
    assert covered >= 31
    spread = float(np.std(errors))
    assert 0.6 < spread < 1.4
    assert fit.dead_time_s.half_width < 0.1


def test_a_hidden_drive_lag_keeps_the_whole_response_right() -> None:
    steps = weighed_steps(3, drive_lag_s=0.5, steps=16)
    response = fit_feeder_response(steps, SCALE_LAG)
    assert response.two_lags is not None
    assert response.response_s.value == pytest.approx(3.3 + 1.2 + 0.5, abs=0.06)
    assert response.unparted(dead_time_s=0.01) != ()


def test_one_lag_is_not_taken_for_two() -> None:
    found = [fit_feeder_response(weighed_steps(seed), SCALE_LAG).two_lags for seed in (20, 21, 22)]
    assert found == [None] * 3


def test_offset_and_slope_are_parted_by_the_levels() -> None:
    response = fit_feeder_response(weighed_steps(5, offset_g_min=0.6, slope=0.9), SCALE_LAG)
    assert response.slope.value == pytest.approx(0.9, abs=0.02)
    assert response.offset_g_min.value == pytest.approx(0.6, abs=0.06)


def test_a_drifting_slope_is_seen() -> None:
    fit = fit_feeder_response(weighed_steps(6, drift_per_h=4.0), SCALE_LAG).one_lag
    low, high = fit.slope_drift_per_h.interval
    assert 0.5 < low < 4.0
    assert 4.0 < high < 7.0


def test_the_lag_of_a_scale_comes_from_a_weight() -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    x = np.maximum(time_s - 2.345, 0.0)
    shown = np.round(np.where(x > 0, 100.0 * -np.expm1(-x / 0.42), 0.0), 2)
    lag_s, share = fit_scale_lag(time_s, shown, 100.0, 0.01)
    assert lag_s.value == pytest.approx(0.42, abs=0.002)
    assert share == pytest.approx(1.0, abs=1e-3)


def test_no_weight_and_no_steps_are_refused() -> None:
    with pytest.raises(ValueError, match="no weight"):
        fit_scale_lag(np.arange(50.0), np.zeros(50), 100.0, 0.01)
    with pytest.raises(ValueError, match="two steps"):
        fit_feeder_response(weighed_steps(0, steps=1), SCALE_LAG)


def test_readings_that_end_before_the_last_step_are_refused() -> None:
    steps = weighed_steps(0)
    short = replace(steps, time_s=steps.time_s[:30], mass_g=steps.mass_g[:30])
    with pytest.raises(ValueError, match="do not reach over the steps"):
        fit_feeder_response(short, SCALE_LAG)
