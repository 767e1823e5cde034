"""Dead times and lags of several hoppers whose powder falls onto one scale.

Each hopper is pulsed in its turn while the others run evenly. The scale shows the sum: one model of
all of them is fitted to it by generalised least squares, as a feeder test fits one hopper
(`step_fit`). Slopes enter with what is known of them; a scale cannot tell the hoppers' offsets
apart, so that one common flow stands for all. A purge is too short to show the noise of the flows:
its kind is taken from the feeder tests, and intervals widen where there is more of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import Estimate
from lmctl.calibration.flow_noise import (
    FlowNoise,
    IncrementWhitener,
    noise_at_least,
    rounding_error_g,
)
from lmctl.calibration.hose_estimate import HoseEstimate
from lmctl.calibration.step_response import (
    SetpointHistory,
    displayed_mass_g,
    nozzle_flow_g_min,
)

#: Noise and response are found in turns so often.
_ROUNDS = 3
#: Dead times are first looked for so far from what is believed, in such steps [s].
_SEARCHED_S, _SEARCH_STEP_S, _SEARCH_TURNS = 2.5, 0.25, 2
_STRIDE = 4  # readings, in that search
#: Ranges that are fitted [s].
_MAX_DEAD_TIME_S, _MAX_LAG_S, _LEAST_LAG_S = 30.0, 15.0, 0.02
_LEAST_RSD = 0.005  # no powder flows evener
_PER_HOSE = 3  # θ, τ, slope
_DIFFERENCE = 1e-4  # of a parameter, for a derivative


@dataclass(frozen=True)
class HoseBelief:
    """What is believed of a hopper before it is measured.

    slope : true flow over set flow, with how well that is known
    """

    dead_time_s: float
    lag_s: float
    slope: Estimate


@dataclass(frozen=True)
class ScaleFacts:
    """lag_s : of the scale, as measured with a known weight
    rsd, correlation_s : of the powder's noise, as a feeder test found it
    resolution_g : of the display
    """

    lag_s: Estimate
    rsd: float
    correlation_s: float
    resolution_g: float


@dataclass(frozen=True)
class SharedScaleFit:
    """hoses, slopes : of each hopper
    more_noise : deviation of the noise over that of the feeder tests; 1 where it is not greater
    whitened_residual : (n − 1,) float64, of variance 1 where the model is right
    """

    hoses: tuple[HoseEstimate, ...]
    slopes: tuple[Estimate, ...]
    more_noise: float
    whitened_residual: FloatArray


class _SharedScale:
    """The model of one record. Parameters: θ, τ, slope of each hopper, scale lag, common flow."""

    def __init__(
        self, histories: Sequence[SetpointHistory], time_s: FloatArray, facts: ScaleFacts,
        beliefs: Sequence[HoseBelief],
    ) -> None:
        self._histories = tuple(histories)
        self._time_s = time_s
        self._middle_s = (time_s[1:] + time_s[:-1]) / 2.0
        slowest_g = sum(h.flow_g_min.min() for h in histories) / 60.0 * float(
            np.median(np.diff(time_s)))
        self.noise = FlowNoise(max(facts.rsd, _LEAST_RSD), max(facts.correlation_s, 0.05),
                               facts.lag_s.value,
                               rounding_error_g(facts.resolution_g, slowest_g))
        self.start = np.array([
            *(value for one in beliefs for value in (one.dead_time_s, one.lag_s, one.slope.value)),
            facts.lag_s.value, 0.0])
        # what is known before the measurement: slopes and scale lag
        known = [(_PER_HOSE * k + 2, one.slope) for k, one in enumerate(beliefs)]
        known.append((len(self.start) - 2, facts.lag_s))
        self._known_at = np.array([at for at, _ in known])
        self._known = np.array([one.value for _, one in known])
        self._known_error = np.array([max(one.standard_error, 1e-4) for _, one in known])
        self.lows = np.array([*[0.0, _LEAST_LAG_S, 0.1] * len(beliefs), 0.0, -100.0])
        self.typical = np.array([*[1.0, 1.0, 0.1] * len(beliefs), 0.1, 0.1])
        self.highs = np.array([*[_MAX_DEAD_TIME_S, _MAX_LAG_S, 10.0] * len(beliefs), 10.0, 100.0])

    def increments_g(self, p: FloatArray) -> FloatArray:
        """Growth of the display between readings, (n − 1,)."""
        mass = p[-1] / 60.0 * (self._time_s - self._time_s[0])
        for k, history in enumerate(self._histories):
            dead_time_s, lag_s, slope = p[_PER_HOSE * k : _PER_HOSE * (k + 1)].tolist()
            mass = mass + displayed_mass_g(
                self._time_s, history, dead_time_s=dead_time_s, lags_s=(lag_s, float(p[-2])),
                slope=slope, offset_g_min=0.0)
        return np.diff(mass)

    def noisy_flow_g_s(self, p: FloatArray) -> FloatArray:
        """What the noise is a share of, (n − 1,): hoppers are unsteady each by itself."""
        squares = np.zeros(len(self._middle_s))
        for k, history in enumerate(self._histories):
            dead_time_s, lag_s, slope = p[_PER_HOSE * k : _PER_HOSE * (k + 1)].tolist()
            squares += nozzle_flow_g_min(self._middle_s, history, dead_time_s=dead_time_s,
                                         lags_s=(lag_s,), slope=slope, offset_g_min=0.0) ** 2
        return np.asarray(np.maximum(np.sqrt(squares) / 60.0, 1e-6))

    def known_residual(self, p: FloatArray) -> FloatArray:
        """How far parameters are from what is known of them, in standard errors."""
        return np.asarray((p[self._known_at] - self._known) / self._known_error)

    def covariance(self, p: FloatArray, whitener: IncrementWhitener) -> FloatArray:
        """Of the parameters, fitted to readings of such noise."""
        columns = []
        for at in range(len(p)):
            step = np.zeros(len(p))
            step[at] = _DIFFERENCE
            columns.append((self.increments_g(p + step) - self.increments_g(p - step))
                           / (2.0 * _DIFFERENCE))
        jacobian = whitener.whiten(np.array(columns).T)
        information = jacobian.T @ jacobian
        information[self._known_at, self._known_at] += self._known_error**-2
        return np.asarray(linalg.pinvh(information))

    def hoses(self, p: FloatArray, covariance: FloatArray) -> tuple[HoseEstimate, ...]:
        return tuple(
            HoseEstimate(float(p[at]), float(p[at + 1]), covariance[at : at + 2, at : at + 2])
            for at in range(0, _PER_HOSE * len(self._histories), _PER_HOSE))

    def slopes(self, p: FloatArray, covariance: FloatArray) -> tuple[Estimate, ...]:
        return tuple(Estimate(float(p[at]), float(np.sqrt(covariance[at, at])))
                     for at in range(2, _PER_HOSE * len(self._histories), _PER_HOSE))


def predicted_hoses(
    histories: Sequence[SetpointHistory], time_s: FloatArray, facts: ScaleFacts,
    beliefs: Sequence[HoseBelief],
) -> tuple[HoseEstimate, ...]:
    """How well pulses would tell each hopper's values, before any powder runs.

    time_s : (n,) float64, when the scale would be read
    returns : the believed values, with the covariance that a fit would have
    """
    model = _SharedScale(histories, time_s, facts, beliefs)
    whitener = IncrementWhitener(time_s, model.noisy_flow_g_s(model.start), model.noise)
    return model.hoses(model.start, model.covariance(model.start, whitener))


def fit_hoses(
    histories: Sequence[SetpointHistory], time_s: FloatArray, mass_g: FloatArray,
    facts: ScaleFacts, beliefs: Sequence[HoseBelief],
) -> SharedScaleFit:
    """Fit all hoppers to what the scale showed.

    time_s, mass_g : (n,) float64 readings by the scale's own stamp, on the clock of the set-points
    """
    model = _SharedScale(histories, time_s, facts, beliefs)
    measured = np.diff(mass_g)
    values = _first_values(histories, time_s, mass_g, facts, beliefs)
    values = np.clip(values, model.lows + 1e-6, model.highs - 1e-6)
    noise = model.noise
    for round_number in range(_ROUNDS):
        flow_g_s = model.noisy_flow_g_s(values)
        if round_number:
            noise = noise_at_least(time_s, flow_g_s, measured - model.increments_g(values),
                                   model.noise)
        whitener = IncrementWhitener(time_s, flow_g_s, noise)

        def residual(p: FloatArray, whitener: IncrementWhitener = whitener) -> FloatArray:
            return np.concatenate([whitener.whiten(model.increments_g(p) - measured),
                                   model.known_residual(p)])

        found = optimize.least_squares(residual, values, bounds=(model.lows, model.highs),
                                       method="trf", x_scale=model.typical, max_nfev=30)
        values = found.x
    covariance = model.covariance(values, whitener)
    return SharedScaleFit(model.hoses(values, covariance), model.slopes(values, covariance),
                          noise.rsd / model.noise.rsd, found.fun[: len(measured)])


def _first_values(
    histories: Sequence[SetpointHistory], time_s: FloatArray, mass_g: FloatArray,
    facts: ScaleFacts, beliefs: Sequence[HoseBelief],
) -> FloatArray:
    """Dead times by plain least squares, one hopper after the other, around what is believed."""
    time_s, measured = time_s[::_STRIDE], np.diff(mass_g[::_STRIDE])
    coarse = list(beliefs)
    model = _SharedScale(histories, time_s, facts, coarse)
    offsets = np.arange(-_SEARCHED_S, _SEARCHED_S + 1e-9, _SEARCH_STEP_S)
    common = np.diff(time_s) / 60.0
    for _ in range(_SEARCH_TURNS):
        for k, belief in enumerate(beliefs):
            costs = []
            tried = [replace(belief, dead_time_s=max(belief.dead_time_s + float(off), 0.0))
                     for off in offsets]
            for one in tried:
                coarse[k] = one
                model = _SharedScale(histories, time_s, facts, coarse)
                rest = measured - model.increments_g(model.start)
                rest = rest - common * float(rest @ common) / float(common @ common)
                costs.append(float(rest @ rest))
            coarse[k] = tried[int(np.argmin(costs))]
    return _SharedScale(histories, time_s, facts, coarse).start
