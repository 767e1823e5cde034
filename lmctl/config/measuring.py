"""Catch scale and calibration of a cell, as a machine profile states them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field, model_validator

from lmctl.config.modbus_device import ModbusDevice
from lmctl.config.quantities import FileName, Name
from lmctl.config.toml_file import ConfigModel


class PurgeMeasuringSettings(ConfigModel):
    """The catch scale stands at the purge position during runs: each purge measures dead times and
    lags with it.

    max_s : most time that this adds to a purge; where no pulse of each hopper fits into it, nothing
        is measured
    precision_s : half width of the 95 % interval of dead time and lag together that is enough
    every_layers : a purge is made after so many layers; 0: only where a run starts or resumes
    """

    max_s: Annotated[float, Field(ge=10, le=600)] = 75.0
    precision_s: Annotated[float, Field(gt=0, le=1)] = 0.05
    every_layers: Annotated[int, Field(ge=0, le=100_000)] = 0


class ScaleSettings(ModbusDevice):
    """The catch scale under the nozzle, see `ModbusDevice` too.

    period_s : how often it is read during a test
    weight_g : of the known weight that its lag is measured with
    purge : what it measures in runs; None: it is used in tests alone
    """

    period_s: Annotated[float, Field(ge=0.05, le=2)] = 0.2
    weight_g: Annotated[float, Field(gt=0, le=100_000)] = 100.0
    purge: PurgeMeasuringSettings | None = None


class CalibrationSettings(ConfigModel):
    """Where the cell's calibration is kept, and how old or foreign it may be.

    file : beside the profile
    warn_after_days, refuse_after_days : age of a measurement from which it is warned of, and from
        which nothing is planned or run with it
    other_conditions : what a measurement does that was made with other gas, powder lot, nozzle or
        standoff than the profile states
    nozzle, standoff_mm : those fitted now
    """

    file: FileName = "calibration.json"
    warn_after_days: Annotated[float, Field(gt=0, le=10_000)] = 30.0
    refuse_after_days: Annotated[float, Field(gt=0, le=10_000)] = 90.0
    other_conditions: Literal["warn", "refuse"] = "warn"
    nozzle: Name | None = None
    standoff_mm: Annotated[float, Field(gt=0, le=200)] | None = None

    @model_validator(mode="after")
    def _warns_first(self) -> CalibrationSettings:
        if self.warn_after_days > self.refuse_after_days:
            raise ValueError("warn_after_days must be at most refuse_after_days, "
                             f"{self.refuse_after_days:g}")
        return self


class FeederCorrectionSettings(ConfigModel):
    """Correction of a feeder's slope during a run, by its hoppers' loss in weight.

    window_s : over which loss in weight and commanded flow are compared
    time_constant_windows : of the integrator; a deviation is taken back to 37 % after so many
    max_share : most a set-point is changed by, as a share of it
    least_level_percent : below this level of the hopper the weight is not relied on
    """

    window_s: Annotated[float, Field(ge=60, le=300)] = 120.0
    time_constant_windows: Annotated[float, Field(ge=10, le=1000)] = 10.0
    max_share: Annotated[float, Field(gt=0, le=0.1)] = 0.1
    least_level_percent: Annotated[float, Field(ge=30, le=100)] = 30.0


#: Lowest and highest value of a 95 % interval; None where it was not measured.
Interval = tuple[float, float] | None


@dataclass(frozen=True)
class HopperIntervals:
    """The intervals of what was measured of one hopper and of the powder in it.

    dead_time_s, lag_s : of the response with one lag, by which powder is led
    response_s : dead time and all lags together
    drive_lag_s : of a drive that lags beside the hose; None too where none shows
    slope, offset_g_min : of true flow against set-point; catch_efficiency : of its powder
    """

    dead_time_s: Interval = None
    lag_s: Interval = None
    response_s: Interval = None
    drive_lag_s: Interval = None
    slope: Interval = None
    offset_g_min: Interval = None
    catch_efficiency: Interval = None


@dataclass(frozen=True)
class FeederTestFacts:
    """What a hopper's feeder test found of the scale and of the powder's noise.

    scale_lag_s : value and half width of its 95 % interval
    noise_rsd, noise_correlation_s : of the flow
    """

    scale_lag_s: tuple[float, float]
    noise_rsd: float
    noise_correlation_s: float


@dataclass(frozen=True)
class CalibrationUse:
    """Which calibration a profile's values come from, as jobs and journals carry it.

    measured : by what was measured ("hopper A", "catch of 316L"): the date of its measurement
    slope_half_widths : by hopper, of the interval of its slope, as a share of it
    intervals : by hopper, of everything measured
    feeder_tests : by hopper, what its test found beside it
    """

    digest: str
    measured: dict[str, str]
    slope_half_widths: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, HopperIntervals] = field(default_factory=dict)
    feeder_tests: dict[str, FeederTestFacts] = field(default_factory=dict)

    def as_json(self) -> dict[str, object]:
        """As manifests and journals hold it."""
        return {"digest": self.digest, "measured": dict(self.measured)}

    @property
    def text(self) -> str:
        """In words."""
        return calibration_text(self.as_json())


def calibration_text(used: dict[str, object]) -> str:
    """What `CalibrationUse.as_json` made, in words; "" for anything else."""
    measured, digest = used.get("measured"), used.get("digest")
    if not isinstance(measured, dict) or not isinstance(digest, str):
        return ""
    of = ", ".join(f"{what} of {str(when)[:10]}" for what, when in measured.items())
    return f"{digest[:12]}: {of or 'nothing of it'}"
