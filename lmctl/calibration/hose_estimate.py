"""Dead time and lag of a hopper's powder, and what a further measurement makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import STANDARD_ERRORS_OF_95_PERCENT, Estimate

#: Two values differ where χ² of two degrees of freedom is beyond this: 99 %.
_DIFFERENT = 9.21
#: A measurement that is this much nearer to itself than to what was believed speaks for itself.
_SURE = 4.0
#: Dead time and lag are told apart by more than this: beyond it a covariance cannot be inverted.
_MAX_CORRELATION = 0.98


@dataclass(frozen=True)
class HoseEstimate:
    """θ and τ with which a hopper's powder is led.

    covariance_s2 : (2, 2) float64 of both; None where they were typed in and never measured
    """

    dead_time_s: float
    lag_s: float
    covariance_s2: FloatArray | None = None

    @classmethod
    def of_half_widths(
        cls, dead_time_s: float, lag_s: float, *, dead_time_half_s: float, lag_half_s: float,
        response_half_s: float,
    ) -> HoseEstimate:
        """From half widths of the 95 % intervals of θ, τ and of their sum, each above 0 [s]."""
        of_dead, of_lag, of_sum = (
            (half / STANDARD_ERRORS_OF_95_PERCENT) ** 2
            for half in (dead_time_half_s, lag_half_s, response_half_s))
        most = _MAX_CORRELATION * float(np.sqrt(of_dead * of_lag))
        shared = float(np.clip((of_sum - of_dead - of_lag) / 2.0, -most, most))
        return cls(dead_time_s, lag_s, np.array([[of_dead, shared], [shared, of_lag]]))

    @property
    def values(self) -> FloatArray:
        """(2,) float64: θ, τ [s]."""
        return np.array([self.dead_time_s, self.lag_s])

    def _estimate(self, weights: tuple[float, float]) -> Estimate:
        row = np.array(weights)
        covariance = np.zeros((2, 2)) if self.covariance_s2 is None else self.covariance_s2
        return Estimate(float(row @ self.values), float(np.sqrt(row @ covariance @ row)))

    @property
    def dead_time(self) -> Estimate:
        """θ with its interval."""
        return self._estimate((1.0, 0.0))

    @property
    def lag(self) -> Estimate:
        """τ with its interval."""
        return self._estimate((0.0, 1.0))

    @property
    def response(self) -> Estimate:
        """θ + τ with its interval: the mean delay of a change, the best known of the three."""
        return self._estimate((1.0, 1.0))


class Revision(StrEnum):
    """What a measurement did to the values in use. The value is what journals hold."""

    AGREES = "agrees"          # joined with what was believed
    REPLACES = "replaces"      # differs, and is sure by itself: taken in place of it
    REFUSED = "refused"        # differs, and is not sure enough: left aside


def revised(present: HoseEstimate, measured: HoseEstimate) -> tuple[Revision, HoseEstimate]:
    """What is to be used after a measurement. measured : with its covariance

    Values that agree are joined, each with the weight of its own certainty, so that the interval
    gets narrower. Where they differ, the older interval has been shown not to hold: its error is
    the difference itself. A measurement that is clearly tighter than that replaces it.
    """
    own = measured.covariance_s2
    if own is None:
        raise ValueError("a measurement has a covariance")
    off = measured.values - present.values
    if present.covariance_s2 is None:
        differs = _distance2(off, own) > _DIFFERENT
        return (Revision.REPLACES if differs else Revision.AGREES), measured
    if _distance2(off, own + present.covariance_s2) <= _DIFFERENT:
        weights = np.linalg.inv(present.covariance_s2), np.linalg.inv(own)
        joint = np.linalg.inv(weights[0] + weights[1])
        dead_time_s, lag_s = (
            joint @ (weights[0] @ present.values + weights[1] @ measured.values)).tolist()
        return Revision.AGREES, HoseEstimate(max(dead_time_s, 0.0), max(lag_s, 0.0), joint)
    if _distance2(off, own) > _SURE * _DIFFERENT:
        return Revision.REPLACES, measured
    return Revision.REFUSED, present


def _distance2(off: FloatArray, covariance: FloatArray) -> float:
    return float(off @ np.linalg.solve(covariance, off))
