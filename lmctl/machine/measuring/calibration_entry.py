"""A hopper's test as an entry of the calibration file."""

from __future__ import annotations

from lmctl.calibration.calibration_file import (
    HopperCalibration,
    MeasuredValue,
    MeasurementConditions,
)
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.machine.measuring.feeder_test import FeederTestResult


def conditions_of(
    profile: MachineProfile, hopper: HopperSettings | None, *, by: str, measured: str
) -> MeasurementConditions:
    """The conditions under which something is measured now, as the profile states them."""
    fitted = profile.calibration
    return MeasurementConditions(
        measured=measured, by=by,
        carrier_L_min=None if hopper is None else hopper.carrier_L_min,
        powder_lot=None if hopper is None else hopper.powder_lot,
        nozzle=None if fitted is None else fitted.nozzle,
        standoff_mm=None if fitted is None else fitted.standoff_mm,
    )


def calibration_entry(
    result: FeederTestResult, profile: MachineProfile, *, by: str, measured: str
) -> HopperCalibration:
    """What the test has found, with the conditions that the profile states."""
    response, fit = result.response, result.response.one_lag
    drive = None if response.two_lags is None else response.two_lags.estimates["drive_lag_s"]
    return HopperCalibration(
        name=result.hopper.name, material=result.hopper.material,
        conditions=conditions_of(profile, result.hopper, by=by, measured=measured),
        dead_time_s=MeasuredValue.of(fit.dead_time_s),
        lag_s=MeasuredValue.of(fit.lag_s),
        response_s=MeasuredValue.of(response.response_s),
        drive_lag_s=None if drive is None else MeasuredValue.of(drive),
        unparted=response.unparted(),
        slope=MeasuredValue.of(response.slope),
        offset_g_min=MeasuredValue.of(response.offset_g_min),
        scale_lag_s=MeasuredValue.of(result.scale_lag_s),
        noise_rsd=round(fit.noise.rsd, 5),
        noise_correlation_s=round(fit.noise.correlation_s, 3),
        levels_g_min=(result.plan.low_g_min, result.plan.high_g_min),
        duration_s=round(result.steps.duration_s, 1),
    )
