"""What a hopper's steps over a scale say of it: generalised least squares, with intervals.

Dead time, lags, slope and offset are fitted to the displayed mass, whitened by the noise of the
flow; noise and fit are found in turns. Drive lag and scale lag enter with what is known of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg, optimize

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import Estimate
from lmctl.calibration.flow_noise import (
    FlowNoise,
    IncrementWhitener,
    fitted_noise,
    rounding_error_g,
)
from lmctl.calibration.step_response import (
    SetpointHistory,
    displayed_mass_g,
    nozzle_flow_g_min,
)

#: Noise and response are found in turns so often.
_ROUNDS = 3
#: A drive lag is there where −2·log likelihood falls by more than this: 99 % of one parameter that
#: cannot be below 0.
_DRIVE_LAG_EVIDENCE = 5.4
#: Ranges that are searched [s].
_MAX_DEAD_TIME_S, _MAX_LAG_S, _LEAST_LAG_S = 30.0, 15.0, 0.02
_COARSE_DEAD_TIMES_S = np.arange(0.0, 12.1, 0.5)
_COARSE_LAGS_S = (0.3, 1.0, 2.5)
_COARSE_STRIDE = 4  # readings

#: No hand puts a weight on as an ideal step: a scale's lag is not known better than this [s].
_LEAST_SCALE_LAG_ERROR_S = 0.003

_NAMES = ("dead_time_s", "lag_s", "slope", "offset_g_min", "scale_lag_s", "drive_lag_s")


@dataclass(frozen=True)
class WeighedSteps:
    """One hopper's test: what was set, and what the scale showed.

    time_s, mass_g : (n,) float64 each, readings of the scale by its own time stamp, on the clock
        of the set-points; the first comes after the first level has settled
    resolution_g : of the display
    """

    history: SetpointHistory
    time_s: FloatArray
    mass_g: FloatArray
    resolution_g: float

    @property
    def duration_s(self) -> float:
        return float(self.time_s[-1] - self.time_s[0])


@dataclass(frozen=True)
class StepFit:
    """A hopper's response as fitted with one model.

    estimates : by name: dead_time_s, lag_s, slope, offset_g_min, scale_lag_s and, where it was
        fitted, drive_lag_s
    response_s : dead time and lags without the scale's: mean delay of a change [s]
    slope_drift_per_h : by which share the slope seems to change in an hour
    minus_2_log_likelihood : of models on the same data, the lower is the likelier
    whitened_residual : (n − 1,) float64, of variance 1 where the model is right
    """

    estimates: Mapping[str, Estimate]
    response_s: Estimate
    noise: FlowNoise
    slope_drift_per_h: Estimate
    minus_2_log_likelihood: float
    whitened_residual: FloatArray

    @property
    def dead_time_s(self) -> Estimate:
        return self.estimates["dead_time_s"]

    @property
    def lag_s(self) -> Estimate:
        return self.estimates["lag_s"]

    @property
    def slope(self) -> Estimate:
        return self.estimates["slope"]

    @property
    def offset_g_min(self) -> Estimate:
        return self.estimates["offset_g_min"]


@dataclass(frozen=True)
class FeederResponse:
    """A hopper as its test shows it.

    one_lag : dead time and one lag, which powder is led by
    two_lags : with the drive's lag beside the hose's; None where nothing shows a second lag
    """

    one_lag: StepFit
    two_lags: StepFit | None

    @property
    def response_s(self) -> Estimate:
        """Dead time and all lags together: known well even where they cannot be parted."""
        return (self.two_lags or self.one_lag).response_s

    @property
    def slope(self) -> Estimate:
        return (self.two_lags or self.one_lag).slope

    @property
    def offset_g_min(self) -> Estimate:
        return (self.two_lags or self.one_lag).offset_g_min

    def unparted(self, dead_time_s: float = 0.1, lag_share: float = 0.1) -> tuple[str, ...]:
        """Values that the test cannot part, in words; empty where every interval is narrow.

        dead_time_s, lag_share : half widths that count as narrow: of a dead time and of a drive
            lag [s], and of a lag as a share of it
        """
        fit = self.two_lags
        if fit is None:
            return ()
        wide = [name for name, is_wide in (
            ("dead time", fit.dead_time_s.half_width > dead_time_s),
            ("hose lag", fit.lag_s.relative_half_width > lag_share),
            ("drive lag", fit.estimates["drive_lag_s"].half_width > dead_time_s),
        ) if is_wide]
        return tuple(wide)


def fit_feeder_response(
    steps: WeighedSteps, scale_lag_s: Estimate, *, drive_lag_s: float = 0.0,
    dead_time_guess_s: float = 3.0,
) -> FeederResponse:
    """Fit a hopper's test with one lag, and with a drive lag beside it where the data ask for it.

    scale_lag_s : as measured with a known weight; its uncertainty is passed on
    drive_lag_s : what is known of the drive's lag; 0 where nothing is known
    Raises ValueError for a test with fewer than two steps, or readings that do not reach over them.
    """
    if steps.history.step_count < 2:
        raise ValueError("a response takes two steps at least")
    if len(steps.time_s) < 20 or steps.time_s[-1] < steps.history.time_s[-1]:
        raise ValueError("the readings do not reach over the steps")
    one = _fit(steps, scale_lag_s, drive_lag_s, _coarse_start(steps, scale_lag_s, drive_lag_s,
                                                              dead_time_guess_s), None)
    start = {name: one.estimates[name].value for name in _NAMES[:5]}
    lag_s = start["lag_s"]
    two = _fit(steps, scale_lag_s, drive_lag_s,
               {**start, "lag_s": 0.8 * lag_s, "drive_lag_s": drive_lag_s + 0.3 * lag_s,
                "dead_time_s": max(start["dead_time_s"] - 0.1 * lag_s, 0.0)}, one.noise)
    gain = one.minus_2_log_likelihood - two.minus_2_log_likelihood
    return FeederResponse(one, two if gain > _DRIVE_LAG_EVIDENCE else None)


def _coarse_start(
    steps: WeighedSteps, scale_lag_s: Estimate, drive_lag_s: float, guess_s: float
) -> dict[str, float]:
    """A first response from plain least squares over a grid of dead times and lags."""
    history, time_s = steps.history, steps.time_s[::_COARSE_STRIDE]
    measured = np.diff(steps.mass_g[::_COARSE_STRIDE])
    ones = np.diff(time_s) / 60.0
    best: tuple[float, dict[str, float]] = (np.inf, {})
    for dead_time_s in sorted({*_COARSE_DEAD_TIMES_S.tolist(), guess_s}):
        for lag_s in _COARSE_LAGS_S:
            unit = np.diff(displayed_mass_g(
                time_s, history, dead_time_s=dead_time_s,
                lags_s=(lag_s, drive_lag_s, scale_lag_s.value), slope=1.0, offset_g_min=0.0))
            columns = np.column_stack([unit, ones])
            found, *_ = np.linalg.lstsq(columns, measured, rcond=None)
            rest = measured - columns @ found
            cost = float(rest @ rest)
            if cost < best[0]:
                best = (cost, {"dead_time_s": dead_time_s, "lag_s": lag_s,
                               "slope": float(found[0]), "offset_g_min": float(found[1]),
                               "scale_lag_s": scale_lag_s.value})
    return best[1]


def _fit(
    steps: WeighedSteps, scale_lag_s: Estimate, drive_lag_s: float, start: dict[str, float],
    noise: FlowNoise | None,
) -> StepFit:
    """Fit the parameters in `start`. noise : a first one, or None."""
    names = tuple(name for name in _NAMES if name in start)
    values = np.array([start[name] for name in names])
    lows = np.array([_LOW[name] for name in names])
    highs = np.array([_HIGH[name] for name in names])
    measured = np.diff(steps.mass_g)
    fixed_noise = noise is not None
    noise = noise or FlowNoise(0.03, 1.0, scale_lag_s.value, _rounding_g(steps))
    scale_at = names.index("scale_lag_s")
    scale_error = max(scale_lag_s.standard_error, 1e-4)
    middle_s = (steps.time_s[1:] + steps.time_s[:-1]) / 2.0

    def modelled(p: FloatArray) -> FloatArray:
        return np.diff(displayed_mass_g(steps.time_s, steps.history,
                                        **_response(names, p, drive_lag_s)))

    values = np.clip(values, lows + 1e-6, highs - 1e-6)
    for round_number in range(_ROUNDS):
        flow_g_s = nozzle_flow_g_min(middle_s, steps.history,
                                     **_response(names, values, drive_lag_s)) / 60.0
        flow_g_s = np.maximum(flow_g_s, 1e-6)
        if round_number and not fixed_noise:
            noise = fitted_noise(steps.time_s, flow_g_s, measured - modelled(values), noise)
        whitener = IncrementWhitener(steps.time_s, flow_g_s, noise)

        def residual(p: FloatArray, whitener: IncrementWhitener = whitener) -> FloatArray:
            prior = (p[scale_at] - scale_lag_s.value) / scale_error
            return np.append(whitener.whiten(modelled(p) - measured), prior)

        found = optimize.least_squares(
            residual, values, bounds=(lows, highs), method="trf",
            x_scale=np.array([_TYPICAL[name] for name in names]), max_nfev=40)
        values = found.x
    covariance = linalg.pinvh(found.jac.T @ found.jac)
    errors = np.sqrt(np.diag(covariance))
    delays = np.array([name in ("dead_time_s", "lag_s", "drive_lag_s") for name in names], float)
    total = float(values @ delays) + (0.0 if "drive_lag_s" in names else drive_lag_s)
    estimates = {name: Estimate(float(value), float(error))
                 for name, value, error in zip(names, values, errors, strict=True)}
    drifting = flow_g_s * np.diff(steps.time_s) * (middle_s - middle_s.mean()) / 3600.0
    return StepFit(
        estimates, Estimate(total, float(np.sqrt(delays @ covariance @ delays))), noise,
        _further_parameter(whitener.whiten(drifting), found),
        float(found.fun @ found.fun) + whitener.log_determinant, found.fun[:-1])


def _rounding_g(steps: WeighedSteps) -> float:
    """Standard deviation of a displayed mass by rounding."""
    growth_g = float(np.median(np.abs(np.diff(steps.mass_g[:: _COARSE_STRIDE])))) / _COARSE_STRIDE
    return rounding_error_g(steps.resolution_g, growth_g * steps.history.lowest_over_highest)


def _further_parameter(column: FloatArray, found: optimize.OptimizeResult) -> Estimate:
    """What one more parameter would be, by one linear step from the fit.

    column : (n − 1,) float64, the whitened model's derivative by it
    """
    others = found.jac[:-1]
    own = column - others @ np.linalg.lstsq(others, column, rcond=None)[0]
    information = float(own @ own)
    return Estimate(float(-found.fun[:-1] @ own) / information, information**-0.5)


_LOW = {"dead_time_s": 0.0, "lag_s": _LEAST_LAG_S, "slope": 0.01, "offset_g_min": -100.0,
        "scale_lag_s": 0.0, "drive_lag_s": 0.0}
_HIGH = {"dead_time_s": _MAX_DEAD_TIME_S, "lag_s": _MAX_LAG_S, "slope": 100.0,
         "offset_g_min": 100.0, "scale_lag_s": 10.0, "drive_lag_s": _MAX_LAG_S}
_TYPICAL = {"dead_time_s": 1.0, "lag_s": 1.0, "slope": 0.1, "offset_g_min": 0.1,
            "scale_lag_s": 0.1, "drive_lag_s": 0.5}


def _response(
    names: tuple[str, ...], values: FloatArray, drive_lag_s: float
) -> dict[str, Any]:
    """The arguments of the model for these parameters."""
    p = dict(zip(names, values.tolist(), strict=True))
    return {
        "dead_time_s": p["dead_time_s"],
        "lags_s": (p["lag_s"], p.get("drive_lag_s", drive_lag_s), p["scale_lag_s"]),
        "slope": p["slope"], "offset_g_min": p["offset_g_min"],
    }


def fit_scale_lag(
    time_s: FloatArray, mass_g: FloatArray, weight_g: float, resolution_g: float
) -> tuple[Estimate, float]:
    """Lag of a scale from a known weight put onto it, and what it shows over the weight.

    time_s, mass_g : (n,) float64, from before the weight to long after it
    weight_g : stated on the weight
    returns : the lag [s]; the displayed change over weight_g
    Raises ValueError where no step of a weight is in the readings.
    """
    before, after = float(np.median(mass_g[:3])), float(np.median(mass_g[-5:]))
    step = after - before
    if not abs(step) > 20 * resolution_g:
        raise ValueError("the readings show no weight put on")
    half = int(np.argmax(np.abs(mass_g - before) > abs(step) / 2))

    def modelled(p: FloatArray) -> FloatArray:
        x = time_s - p[0]
        return np.asarray(before + p[2] * np.where(x > 0, -np.expm1(-np.maximum(x, 0) / p[1]), 0.0))

    sigma = max(resolution_g / 12**0.5, 1e-6)
    best = None
    for lag_s in (0.05, 0.3, 1.0):
        found = optimize.least_squares(
            lambda p: (modelled(p) - mass_g) / sigma,
            [time_s[half] - 0.7 * lag_s, lag_s, step],
            bounds=([time_s[0], 1e-3, -np.inf], [time_s[-1], 30.0, np.inf]), x_scale=[0.1, 0.1, 1])
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    covariance = linalg.pinvh(best.jac.T @ best.jac)
    # the hand that puts it on, and the scale's own cycle, are no part of the model: honest spread
    spread = max(1.0, float(np.sqrt(2.0 * best.cost / max(len(time_s) - 3, 1))))
    error = max(float(np.sqrt(covariance[1, 1])) * spread, _LEAST_SCALE_LAG_ERROR_S)
    return Estimate(float(best.x[1]), error), float(best.x[2]) / weight_g
