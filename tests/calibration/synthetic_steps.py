"""Weighed steps made without the estimators' own arithmetic: flow summed up, step by step."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from lmctl.calibration.step_fit import WeighedSteps
from lmctl.calibration.step_response import SetpointHistory

STEP_S = 0.02


def weighed_steps(
    seed: int, *, dead_time_s: float = 3.3, lag_s: float = 1.2, drive_lag_s: float = 0.0,
    slope: float = 1.05, offset_g_min: float = 0.0, scale_lag_s: float = 0.3, rsd: float = 0.03,
    correlation_s: float = 1.0, low: float = 2.0, high: float = 16.0, hold_s: float = 15.0,
    steps: int = 8, every: int = 20, drift_per_h: float = 0.0,
) -> WeighedSteps:
    """A feeder stepped between two levels, read through a scale, by Euler steps of 0.02 s."""
    random = np.random.default_rng(seed)
    begin_s = 20.0
    time_s = np.arange(0.0, begin_s + hold_s * steps, STEP_S)
    set_s = np.concatenate([[-100.0], begin_s + hold_s * np.arange(steps)])
    set_s[1:] += np.round(random.uniform(0.0, 0.1, steps) / STEP_S) * STEP_S
    levels = np.where(np.arange(steps + 1) % 2 == 0, low, high)
    at = np.searchsorted(set_s, time_s - dead_time_s + 1e-9, side="right") - 1
    drift = 1.0 + drift_per_h * time_s / 3600.0
    flow = (offset_g_min + slope * drift * levels[np.maximum(at, 0)]) / 60.0
    for lag in (drive_lag_s, lag_s):
        flow = lagged(flow, lag)
    keep = np.exp(-STEP_S / correlation_s)
    noise, _ = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], random.standard_normal(len(time_s)),
                       zi=[keep * random.standard_normal()])
    mass = np.cumsum(flow * (1.0 + rsd * noise)) * STEP_S
    read = np.arange(int(14.0 / STEP_S), len(time_s), every)
    shown = np.round(lagged(mass, scale_lag_s)[read], 2)
    return WeighedSteps(SetpointHistory(set_s, levels), time_s[read] + STEP_S, shown, 0.01)


def lagged(values: np.ndarray, lag_s: float) -> np.ndarray:
    """First-order lag of samples that hold for one step each, from rest at the first."""
    if lag_s <= 0:
        return values
    keep = np.exp(-STEP_S / lag_s)
    return lfilter([1 - keep], [1.0, -keep], values, zi=[keep * values[0]])[0]
