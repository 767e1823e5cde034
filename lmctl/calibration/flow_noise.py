"""Noise of a weighed powder flow: correlated in the flow, added up in the mass, rounded.

The covariance of two masses is the double sum of σq(t)·σq(t′)·exp(−|t−t′|/T) over the times up to
each, and the rounding of the display. Here it is written for the increments between readings, which
hold the same information: far-off increments do not depend on each other, so that their covariance
has a narrow band and its Cholesky factor is cheap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize

from lmctl.array_types import FloatArray

#: exp(−10) of a correlation is none.
_BAND_CORRELATION_TIMES = 10.0
_MAX_BAND = 400
#: Correlation times that are looked for [s], and relative deviations.
_CORRELATION_RANGE_S = (0.05, 6.0)
_RSD_RANGE = (1e-5, 0.5)


@dataclass(frozen=True)
class FlowNoise:
    """rsd : relative standard deviation σ of the flow; correlation_s : T of exp(−|Δt|/T)
    scale_lag_s : of the scale, which smooths what it shows
    rounding_g : standard deviation of a displayed mass: resolution/√12
    """

    rsd: float
    correlation_s: float
    scale_lag_s: float
    rounding_g: float


def rounding_error_g(resolution_g: float, slowest_growth_g: float) -> float:
    """Standard deviation of a displayed mass by rounding.

    A display that stands still over several readings rounds them all alike: they count as one.
    slowest_growth_g : between two readings
    """
    alike = max(1.0, min(resolution_g / max(slowest_growth_g, 1e-9), 10.0))
    return resolution_g * math.sqrt(alike / 12.0)


def _half_exponential(step_s: FloatArray, T: float) -> FloatArray:
    """2T·sinh(h/2T) of each interval's length h.

    ∫∫ exp(−|x−y|/T) over two intervals that do not overlap is the product of theirs, times
    exp(−d/T) with d the distance of their middles.
    """
    return np.asarray(2.0 * T * np.sinh(np.minimum(step_s / (2.0 * T), 50.0)))


def _own_exponential(step_s: FloatArray, T: float) -> FloatArray:
    """∫∫ exp(−|x−y|/T) over one interval twice."""
    x = step_s / T
    return np.asarray(2.0 * T * T * (x + np.expm1(-x)))


class IncrementWhitener:
    """Turns increments of a displayed mass into independent values of variance 1.

    time_s : (n + 1,) float64, rising times of the readings
    flow_g_s : (n,) float64, flow in the middle of each increment, which the noise is a share of
    """

    def __init__(self, time_s: FloatArray, flow_g_s: FloatArray, noise: FlowNoise) -> None:
        self._lower = linalg.cholesky_banded(
            _banded_covariance(time_s, np.abs(flow_g_s), noise), lower=True, check_finite=False)

    def whiten(self, increments: FloatArray) -> FloatArray:
        """L⁻¹·increments; increments : (n,) or (n, m) float64 [g]."""
        columns = increments if increments.ndim == 2 else increments[:, None]
        white, _ = linalg.lapack.dtbtrs(self._lower, columns, uplo="L")
        return np.asarray(white).reshape(increments.shape)

    @property
    def log_determinant(self) -> float:
        """log det of the covariance."""
        return float(2.0 * np.log(self._lower[0]).sum())


def _banded_covariance(time_s: FloatArray, flow_g_s: FloatArray, noise: FlowNoise) -> FloatArray:
    """Lower band of the increments' covariance, as scipy's banded routines take it."""
    step_s = np.diff(time_s)
    middle_s = time_s[:-1] + step_s / 2.0
    n = len(step_s)
    sigma = noise.rsd * flow_g_s
    terms = _correlation_terms(noise)
    reach_s = _BAND_CORRELATION_TIMES * max(T for _, T in terms)
    width = int(min(max(math.ceil(reach_s / float(np.median(step_s))), 1), _MAX_BAND, n - 1))
    band = np.zeros((width + 1, n))
    band[0] = sum(share * _own_exponential(step_s, T) for share, T in terms) * sigma**2
    is_even = float(np.ptp(step_s)) < 1e-6
    for share, T in terms:
        weighted = sigma * _half_exponential(step_s, T)
        for lag in range(1, width + 1):
            apart_s = middle_s[lag] - middle_s[0] if is_even else middle_s[lag:] - middle_s[:-lag]
            fallen = share * np.exp(-apart_s / T)
            band[lag, : n - lag] += weighted[lag:] * weighted[:-lag] * fallen
    rounding = noise.rounding_g**2
    band[0] += 2.0 * rounding
    if width:
        band[1, : n - 1] -= rounding
    band[0] *= 1.0 + 1e-9
    return band


def _correlation_terms(noise: FlowNoise) -> list[tuple[float, float]]:
    """The autocovariance behind the scale's lag τ as Σ share·exp(−|x|/T_i).

    exp(−|x|/T) through a lag τ is T/(T² − τ²)·(T·exp(−|x|/T) − τ·exp(−|x|/τ)).
    """
    T, tau = noise.correlation_s, noise.scale_lag_s
    if tau < 1e-3:
        return [(1.0, T)]
    if abs(T - tau) < 0.02 * tau:
        T = 1.02 * tau
    scale = T / (T * T - tau * tau)
    return [(scale * T, T), (-scale * tau, tau)]


def fitted_noise(
    time_s: FloatArray, flow_g_s: FloatArray, residual_g: FloatArray, start: FlowNoise
) -> FlowNoise:
    """The noise under which residuals are likeliest.

    residual_g : (n,) float64, measured less modelled increments
    start : where the search begins; its scale lag and rounding are kept
    """
    lows = np.log([_RSD_RANGE[0], _CORRELATION_RANGE_S[0]])
    highs = np.log([_RSD_RANGE[1], _CORRELATION_RANGE_S[1]])

    def noise_at(logs: FloatArray) -> FlowNoise:
        rsd, correlation_s = np.exp(np.clip(logs, lows, highs)).tolist()
        return FlowNoise(rsd, correlation_s, start.scale_lag_s, start.rounding_g)

    def cost(logs: FloatArray) -> float:
        try:
            whitener = IncrementWhitener(time_s, flow_g_s, noise_at(logs))
        except linalg.LinAlgError:
            return 1e30
        white = whitener.whiten(residual_g)
        return float(white @ white) + whitener.log_determinant

    found = optimize.minimize(
        cost, np.log([start.rsd, start.correlation_s]), method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.05, "maxfev": 60,
                 "initial_simplex": np.log([start.rsd, start.correlation_s])
                 + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.7]])})
    return noise_at(found.x)


def noise_at_least(
    time_s: FloatArray, flow_g_s: FloatArray, residual_g: FloatArray, known: FlowNoise
) -> FlowNoise:
    """The noise known of a flow, or so much more of its kind as makes residuals likeliest.

    For records too short to show how the noise is correlated.
    residual_g : (n,) float64, measured less modelled increments
    """
    def cost(log_rsd: float) -> float:
        noise = replace(known, rsd=math.exp(log_rsd))
        whitener = IncrementWhitener(time_s, flow_g_s, noise)
        white = whitener.whiten(residual_g)
        return float(white @ white) + whitener.log_determinant

    least, most = math.log(known.rsd), math.log(max(_RSD_RANGE[1], 2.0 * known.rsd))
    found = optimize.minimize_scalar(cost, bounds=(least, most), method="bounded",
                                     options={"xatol": 0.02})
    return known if cost(least) <= found.fun else replace(known, rsd=math.exp(found.x))
