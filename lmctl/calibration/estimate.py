"""A measured value with its standard error and its confidence interval."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Half width of a 95 % interval of a normal distribution, in standard errors.
STANDARD_ERRORS_OF_95_PERCENT = 1.96


@dataclass(frozen=True)
class Estimate:
    """One measured value. standard_error : ≥ 0, in the unit of the value"""

    value: float
    standard_error: float

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval."""
        return STANDARD_ERRORS_OF_95_PERCENT * self.standard_error

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval (low, high)."""
        return self.value - self.half_width, self.value + self.half_width

    @property
    def relative_half_width(self) -> float:
        """Half of the 95 % interval over the value; infinite for a value of 0."""
        return self.half_width / abs(self.value) if self.value else math.inf

    def text(self, decimals: int, unit: str = "") -> str:
        """The value with its half width, as people read it.

        >>> Estimate(3.0213, 0.02).text(2, "s")
        '3.02 ± 0.04 s'
        """
        return f"{self.value:.{decimals}f} ± {self.half_width:.{decimals}f} {unit}".rstrip()
