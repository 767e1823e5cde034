"""The file `calibration.json`: what a cell has measured of itself, and under which conditions."""

from __future__ import annotations

import hashlib
import json
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from lmctl.calibration.estimate import Estimate
from lmctl.config.quantities import Name
from lmctl.config.toml_file import ConfigModel, read_text, validated_model
from lmctl.errors import ConfigError

FORMAT_NAME = "lmctl-calibration-1"

_Time = Annotated[float, Field(ge=-10, le=600)]


class MeasuredValue(ConfigModel):
    """A value and its 95 % interval: low ≤ value ≤ high."""

    value: float
    low: float
    high: float

    @model_validator(mode="after")
    def _inside(self) -> MeasuredValue:
        if not self.low <= self.value <= self.high:
            raise ValueError(f"the value {self.value:g} is not within its interval "
                             f"{self.low:g} to {self.high:g}")
        return self

    @classmethod
    def of(cls, estimate: Estimate, digits: int = 5) -> MeasuredValue:
        """An estimate as it is stored: rounded to so many digits behind the point."""
        low, high = estimate.interval
        return cls(value=round(estimate.value, digits), low=round(low, digits),
                   high=round(high, digits))

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.high - self.low) / 2.0


class MeasurementConditions(ConfigModel):
    """Under which conditions something was measured, when, and by whom.

    measured : UTC, as 2026-11-30T02:41:07Z
    powder_lot, nozzle, standoff_mm : None where not stated
    """

    measured: str
    by: str
    carrier_L_min: Annotated[float, Field(gt=0, le=100)] | None = None
    powder_lot: Name | None = None
    nozzle: Name | None = None
    standoff_mm: Annotated[float, Field(gt=0, le=200)] | None = None

    @field_validator("measured")
    @classmethod
    def _a_time(cls, value: str) -> str:
        try:
            if datetime.fromisoformat(value).tzinfo is None:
                raise ValueError
        except ValueError:
            raise ValueError(f"{value[:40]!r} is no time such as 2026-11-30T02:41:07Z") from None
        return value

    def age_days(self, now: datetime) -> float:
        """Days from the measurement to now, which carries its time zone."""
        return (now - datetime.fromisoformat(self.measured)).total_seconds() / 86_400.0


class HopperCalibration(ConfigModel):
    """A hopper as its feeder test has found it.

    dead_time_s, lag_s : θ and τ with which powder is led: the best response with one lag
    response_s : dead time and all lags together, the mean delay of a change
    drive_lag_s : of the drive, where the test shows a second lag; None where it does not
    unparted : what of these the test cannot part, in words
    slope, offset_g_min : the true flow is offset + slope · set-point
    noise_rsd, noise_correlation_s : unsteadiness of the flow
    levels_g_min : least and greatest set-point of the test
    """

    name: Name
    material: Name
    conditions: MeasurementConditions
    dead_time_s: MeasuredValue
    lag_s: MeasuredValue
    response_s: MeasuredValue
    drive_lag_s: MeasuredValue | None = None
    unparted: tuple[Name, ...] = ()
    slope: MeasuredValue
    offset_g_min: MeasuredValue
    scale_lag_s: MeasuredValue
    noise_rsd: Annotated[float, Field(ge=0, le=1)]
    noise_correlation_s: Annotated[float, Field(ge=0, le=60)]
    levels_g_min: tuple[float, float]
    duration_s: Annotated[float, Field(gt=0, le=100_000)]


class CatchCalibration(ConfigModel):
    """Catch efficiency of a powder, or of a mixture, as coupons have shown it.

    mass_shares : of each material fed, by name; one material of share 1 for a single powder
    efficiency : deposited over fed mass
    """

    mass_shares: dict[str, Annotated[float, Field(gt=0, le=1)]]
    conditions: MeasurementConditions
    efficiency: MeasuredValue
    fed_g: Annotated[float, Field(gt=0, le=1e6)]
    deposited_g: Annotated[float, Field(gt=0, le=1e6)]

    @model_validator(mode="after")
    def _plausible(self) -> CatchCalibration:
        wrong = []
        if abs(sum(self.mass_shares.values()) - 1.0) > 0.01:
            wrong.append("mass_shares do not add up to 1")
        if not 0 < self.efficiency.value <= 1:
            wrong.append(f"an efficiency of {self.efficiency.value:g} is not within 0 and 1")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self


class DilutionCalibration(ConfigModel):
    """Dilution δ of a coupon's first layer against its energy per length.

    dilution : share of the layer below in the bead, 0 to 1
    """

    material: Name
    substrate: Name
    conditions: MeasurementConditions
    energy_J_mm: Annotated[float, Field(gt=0, le=1e6)]
    dilution: MeasuredValue

    @model_validator(mode="after")
    def _plausible(self) -> DilutionCalibration:
        if not 0 <= self.dilution.value < 1:
            raise ValueError(f"a dilution of {self.dilution.value:g} is not within 0 and 1")
        return self


class Calibration(ConfigModel):
    """Everything a cell has measured of itself; the newest of each kind.

    machine : name of the profile
    """

    format: Literal["lmctl-calibration-1"] = "lmctl-calibration-1"
    machine: Name
    hopper: tuple[HopperCalibration, ...] = ()
    catch: tuple[CatchCalibration, ...] = ()
    dilution: tuple[DilutionCalibration, ...] = ()

    @model_validator(mode="after")
    def _one_each(self) -> Calibration:
        names = [hopper.name for hopper in self.hopper]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two calibrations of hopper {', '.join(twice)}")
        return self

    @property
    def digest(self) -> str:
        """SHA-256 of everything in it."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def hopper_calibration(self, name: str) -> HopperCalibration | None:
        """The calibration of a hopper by its name, or None."""
        return next((hopper for hopper in self.hopper if hopper.name == name), None)

    def catch_of(self, material: str) -> CatchCalibration | None:
        """The single-powder catch of a material, or None."""
        return next((c for c in self.catch if set(c.mass_shares) == {material}), None)

    def mixtures(self) -> tuple[CatchCalibration, ...]:
        """The catch of mixtures of two powders."""
        return tuple(c for c in self.catch if len(c.mass_shares) == 2)

    def with_hopper(self, new: HopperCalibration) -> Calibration:
        """The same with one hopper's calibration put in or replaced."""
        others = tuple(hopper for hopper in self.hopper if hopper.name != new.name)
        return self.model_copy(update={"hopper": (*others, new)})

    def with_catch(self, new: CatchCalibration) -> Calibration:
        """The same with the catch of a powder or mixture put in or replaced."""
        others = tuple(c for c in self.catch if not _is_same_mixture(c.mass_shares,
                                                                     new.mass_shares))
        return self.model_copy(update={"catch": (*others, new)})

    def with_dilution(self, new: DilutionCalibration) -> Calibration:
        """The same with one dilution put in; one of the same material and energy is replaced."""
        others = tuple(
            d for d in self.dilution
            if (d.material, d.substrate) != (new.material, new.substrate)
            or abs(d.energy_J_mm - new.energy_J_mm) > 0.02 * new.energy_J_mm)
        return self.model_copy(update={"dilution": (*others, new)})


def _is_same_mixture(one: dict[str, float], other: dict[str, float]) -> bool:
    return set(one) == set(other) and all(abs(one[name] - other[name]) < 0.02 for name in one)


def calibration_stamp(now: datetime | None = None) -> str:
    """A time as calibrations carry it: UTC, to the second."""
    now = now or datetime.now(UTC)
    return now.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def load_calibration(path: Path) -> Calibration:
    """Read a calibration. Raises MissingFileError; ConfigError with every mistake at once, and for
    a file that was altered since it was written."""
    text = read_text(path)
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path} is not valid JSON", where=str(error)[:200],
                          hint="restore it from a copy, or measure again: `lmctl machine "
                               "feeder-test` makes a new one") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{path} is no calibration", where="it holds no table",
                          hint="`lmctl machine feeder-test` makes one")
    if data.get("format") != FORMAT_NAME:
        raise ConfigError(f"{path} is no calibration of a known format",
                          where=f"its format is {str(data.get('format'))[:40]!r}",
                          hint=f"{FORMAT_NAME} is read here")
    digest = data.pop("digest", None)
    found = validated_model(data, Calibration, name=str(path))
    if digest != found.digest:
        raise ConfigError(f"{path} was altered since it was written",
                          where=f"its digest is {str(digest)[:16]}, and what it holds makes "
                                f"{found.digest[:16]}",
                          hint="measure again, or bring back the file that was written")
    return found


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write a calibration, whole or not at all. Raises ConfigError where it cannot be written."""
    data = {**calibration.model_dump(mode="json", exclude_none=True),
            "digest": calibration.digest}
    unfinished = path.with_name(path.name + ".part")
    try:
        unfinished.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n",
                              encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as error:
        raise ConfigError.cannot_write(path, error) from None
