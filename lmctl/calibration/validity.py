"""Whether a calibration holds for a cell as it stands, and the profile with what was measured.

Values that are too old, or were measured under other conditions, are warned of or refused, as the
profile configures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from lmctl.calibration.calibration_file import (
    Calibration,
    CatchCalibration,
    HopperCalibration,
    MeasuredValue,
    MeasurementConditions,
)
from lmctl.config.dilution import MAX_DILUTION, DilutionSettings
from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.config.measuring import (
    CalibrationSettings,
    CalibrationUse,
    FeederTestFacts,
    HopperIntervals,
    Interval,
)
from lmctl.config.mixture_catch import MixtureCatchSettings
from lmctl.errors import ConfigError

#: Gas flows that count as equal: a flow meter's tolerance.
_SAME_GAS = 0.05
_SAME_STANDOFF_MM = 0.5


@dataclass(frozen=True)
class CalibrationFinding:
    """Why a measured value is doubtful. refuses : nothing is planned or run with it"""

    what: str
    text: str
    refuses: bool


def calibration_findings(
    calibration: Calibration, profile: MachineProfile, now: datetime
) -> Iterator[CalibrationFinding]:
    """Everything doubtful about a calibration for this cell, all at once.

    now : with its time zone
    """
    limits = profile.calibration or CalibrationSettings()
    if calibration.machine != profile.name:
        yield CalibrationFinding(
            "calibration", f"it was made on {calibration.machine!r}, and this is "
            f"{profile.name!r}", refuses=True)
    for hopper in profile.hopper:
        measured = calibration.hopper_calibration(hopper.name)
        if measured is None:
            yield CalibrationFinding(
                f"hopper {hopper.name}", "it has no feeder test: the profile's own values are used",
                refuses=False)
        elif measured.material != hopper.material:
            yield CalibrationFinding(
                f"hopper {hopper.name}",
                f"it was tested with {measured.material}, and holds {hopper.material}",
                refuses=True)
        else:
            yield from _doubts(f"hopper {hopper.name}", measured.conditions, limits, hopper, now)
        caught = calibration.catch_of(hopper.material)
        if caught is not None:
            yield from _doubts(f"catch of {hopper.material}", caught.conditions, limits, hopper,
                               now)
    for mixture in calibration.mixtures():
        yield from _doubts(f"catch of {' + '.join(mixture.mass_shares)}", mixture.conditions,
                           limits, None, now)
    for dilution in calibration.dilution:
        yield from _doubts(f"dilution of {dilution.material} on {dilution.substrate}",
                           dilution.conditions, limits, None, now)


def _doubts(
    what: str, conditions: MeasurementConditions, limits: CalibrationSettings,
    hopper: HopperSettings | None, now: datetime,
) -> Iterator[CalibrationFinding]:
    age = conditions.age_days(now)
    if age >= limits.warn_after_days:
        refuses = age >= limits.refuse_after_days
        limit = limits.refuse_after_days if refuses else limits.warn_after_days
        yield CalibrationFinding(what, f"measured {age:.0f} days ago, on "
                                 f"{conditions.measured[:10]}; the profile "
                                 f"{'refuses' if refuses else 'warns'} from {limit:g} days on",
                                 refuses)
    elif age < -1.0:
        yield CalibrationFinding(what, f"measured on {conditions.measured[:10]}, which is in the "
                                 "future: is the clock right?", refuses=True)
    for text in _other_conditions(conditions, limits, hopper):
        yield CalibrationFinding(what, text, limits.other_conditions == "refuse")


def _other_conditions(
    conditions: MeasurementConditions, limits: CalibrationSettings, hopper: HopperSettings | None
) -> Iterator[str]:
    """In what the conditions differ from those of now; what is not stated is not compared."""
    if hopper is not None:
        gas = conditions.carrier_L_min
        if gas is not None and abs(gas - hopper.carrier_L_min) > _SAME_GAS * gas:
            yield (f"measured with {gas:g} L/min of carrier gas, and the profile has "
                   f"{hopper.carrier_L_min:g}")
        if hopper.powder_lot is not None and conditions.powder_lot != hopper.powder_lot:
            yield (f"measured with powder lot {conditions.powder_lot or 'unknown'}, and the "
                   f"profile has {hopper.powder_lot}")
    if limits.nozzle is not None and conditions.nozzle != limits.nozzle:
        yield (f"measured with nozzle {conditions.nozzle or 'unknown'}, and the profile has "
               f"{limits.nozzle}")
    standoff = conditions.standoff_mm
    if standoff is not None and limits.standoff_mm is not None and (
        abs(standoff - limits.standoff_mm) > _SAME_STANDOFF_MM
    ):
        yield f"measured at {standoff:g} mm standoff, and the profile has {limits.standoff_mm:g}"


def refuse_invalid(findings: list[CalibrationFinding], where: str) -> None:
    """Raise ConfigError where findings refuse the calibration, with all of them.

    where : the file
    """
    wrong = [finding for finding in findings if finding.refuses]
    if wrong:
        raise ConfigError(
            f"{where} does not hold for this cell",
            where=[f"{finding.what}: {finding.text}" for finding in wrong],
            hint="measure again: `lmctl machine feeder-test`, `catch-test` or `dilution-test`; or "
            "take [calibration] out of the profile to work with its own values",
        )


def calibrated_profile(profile: MachineProfile, calibration: Calibration) -> MachineProfile:
    """The profile with what was measured in place of what was typed in; it says so itself."""
    measured: dict[str, str] = {}
    half_widths: dict[str, float] = {}
    intervals: dict[str, HopperIntervals] = {}
    feeder_tests: dict[str, FeederTestFacts] = {}
    hoppers = []
    for hopper in profile.hopper:
        update: dict[str, object] = {}
        test = calibration.hopper_calibration(hopper.name)
        if test is not None and test.material != hopper.material:
            test = None
        if test is not None:
            measured[f"hopper {hopper.name}"] = test.conditions.measured
            half_widths[hopper.name] = test.slope.half_width / test.slope.value
            feeder_tests[hopper.name] = FeederTestFacts(
                (test.scale_lag_s.value, test.scale_lag_s.half_width), test.noise_rsd,
                test.noise_correlation_s)
            update |= {
                "dead_time_s": max(test.dead_time_s.value, 0.0),
                "lag_s": max(test.lag_s.value, 0.0),
                "slope": test.slope.value, "offset_g_min": test.offset_g_min.value,
            }
        caught = calibration.catch_of(hopper.material)
        if caught is not None:
            measured[f"catch of {hopper.material}"] = caught.conditions.measured
            update["catch_efficiency"] = caught.efficiency.value
        if test is not None or caught is not None:
            intervals[hopper.name] = _intervals(test, caught)
        hoppers.append(hopper.model_copy(update=update))
    dilution = _measured_dilution(profile, calibration)
    for one in calibration.dilution:
        measured[f"dilution of {one.material}"] = one.conditions.measured
    mixtures = _measured_mixtures(profile, calibration)
    for mixture in calibration.mixtures():
        measured[f"catch of {' + '.join(mixture.mass_shares)}"] = mixture.conditions.measured
    return profile.with_measured_values(
        tuple(hoppers), dilution, mixtures,
        CalibrationUse(calibration.digest, measured, half_widths, intervals, feeder_tests))


def _measured_mixtures(
    profile: MachineProfile, calibration: Calibration
) -> tuple[MixtureCatchSettings, ...]:
    """Measured catch of pairs of powders, and typed values of other pairs."""
    measured = tuple(MixtureCatchSettings(mass_shares=one.mass_shares,
                                          efficiency=one.efficiency.value)
                     for one in calibration.mixtures())
    pairs = [set(one.mass_shares) for one in measured]
    return (*measured, *(typed for typed in profile.mixture_catch
                         if set(typed.mass_shares) not in pairs))


def _measured_dilution(
    profile: MachineProfile, calibration: Calibration
) -> tuple[DilutionSettings, ...]:
    """Measured dilutions, and those typed in of powders that were not tested."""
    tested = {one.material for one in calibration.dilution}
    return (
        *(DilutionSettings(
            share=min(one.dilution.value, MAX_DILUTION), low=max(one.dilution.low, 0.0),
            high=min(one.dilution.high, MAX_DILUTION), energy_J_mm=one.energy_J_mm,
            material=one.material)
          for one in calibration.dilution),
        *(typed for typed in profile.dilution if typed.material not in tested
          and not (typed.material is None and tested)))


def _intervals(test: HopperCalibration | None, caught: CatchCalibration | None) -> HopperIntervals:
    def ends(value: MeasuredValue | None) -> Interval:
        return None if value is None else (value.low, value.high)

    catch = None if caught is None else ends(caught.efficiency)
    if test is None:
        return HopperIntervals(catch_efficiency=catch)
    return HopperIntervals(
        ends(test.dead_time_s), ends(test.lag_s), ends(test.response_s), ends(test.drive_lag_s),
        ends(test.slope), ends(test.offset_g_min), catch)
