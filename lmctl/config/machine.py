"""The machine profile: endpoints, travel, dynamics, laser, hoppers, as written in TOML.

The profile holds everything that differs between a real cell and the bench; the code is the same.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, PrivateAttr, field_validator, model_validator

from lmctl.config import toml_file
from lmctl.config.dilution import DilutionSettings, dilution_mistakes
from lmctl.config.feeder_maps import feeders_with_maps
from lmctl.config.feeders import FeederSettings, HopperSettings, PlainName
from lmctl.config.measuring import (
    CalibrationSettings,
    CalibrationUse,
    ScaleSettings,
)
from lmctl.config.mixture_catch import MixtureCatchSettings
from lmctl.config.modbus_device import ModbusDevice
from lmctl.config.nozzle import NozzleSettings
from lmctl.config.quantities import Coordinate, Length, Vector
from lmctl.config.toml_file import ConfigModel

#: Wider than any machine; a figure beyond these limits is in other units, or a typing error.
Speed = Annotated[float, Field(ge=0.01, le=100_000)]
Acceleration = Annotated[float, Field(ge=0.1, le=1_000_000)]
Power = Annotated[float, Field(gt=0, le=1_000_000)]
#: Reports that must come within the send horizon: each report releases lines, and with fewer
#: reports motion runs dry between two of them.
_REPORTS_PER_HORIZON = 2

_ROUNDING_S = 1e-9


class AxisTravel(ConfigModel):
    """Reachable range of each axis in program coordinates [mm]: (least, greatest).

    x, y, z : the least and the greatest coordinate
    """

    x: tuple[Coordinate, Coordinate]
    y: tuple[Coordinate, Coordinate]
    z: tuple[Coordinate, Coordinate]

    @field_validator("x", "y", "z")
    @classmethod
    def _ordered(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] >= value[1]:
            raise ValueError(f"the first value must be below the second, not {list(value)}")
        return value


class MotionSettings(ConfigModel):
    """The motion controller: its link and the dynamics planning must know.

    endpoint : "tcp://HOST:PORT", "serial:///dev/ttyUSB0" or "pty:///dev/pts/3"
    baud : line rate of a serial endpoint; ignored on TCP and ptys
    clearance_mm : lift above the layer for travel
    purge_mm : where the nozzle waits while powder settles; every program starts there
    send_horizon_s : most unexecuted motion the controller may hold
    status_period_s : interval of its status reports; half the horizon at most
    travel_mm : what each axis can reach
    max_speed_mm_s, acceleration_mm_s2 : of x, y and z
    junction_deviation_mm : of the controller's own cornering ($11)
    planner_blocks : motions that its planner holds
    """

    endpoint: str
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 115_200
    travel_mm: AxisTravel
    max_speed_mm_s: tuple[Speed, Speed, Speed]
    acceleration_mm_s2: tuple[Acceleration, Acceleration, Acceleration]
    junction_deviation_mm: Annotated[float, Field(gt=0, le=10)] = 0.01
    planner_blocks: Annotated[int, Field(ge=4, le=1000)] = 15
    clearance_mm: Length = 5.0
    purge_mm: Vector
    send_horizon_s: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    status_period_s: Annotated[float, Field(ge=0.02, le=1)] = 0.2

    @model_validator(mode="after")
    def _reported_in_time(self) -> MotionSettings:
        most_s = self.send_horizon_s / _REPORTS_PER_HORIZON
        if self.status_period_s > most_s + _ROUNDING_S:
            raise ValueError(
                f"status_period_s must be at most half of send_horizon_s, {most_s:g} s"
            )
        return self


class LaserSettings(ConfigModel):
    """s_max : the controller's $30, the S word that means full power.

    max_power_W : at full power
    """

    max_power_W: Power
    s_max: Annotated[int, Field(ge=1, le=65_535)] = 1000


SafetyInput = Literal[
    "estop", "door", "laser_ready", "laser_fault", "back_reflection", "chiller", "shield_gas",
    "extraction", "oxygen", "key",
]
SAFETY_INPUTS: tuple[SafetyInput, ...] = get_args(SafetyInput)

#: Heartbeats that may be missed before a watchdog relay opens: one lost answer must not stop a run.
_RELAY_PERIODS = 3


class SafetySettings(ModbusDevice):
    """The safety-input device: the state of the cell's safety circuits, as the host may read it.

    period_s : of its heartbeat; each heartbeat also reads the inputs
    relay_timeout_s : its watchdog relay opens after this time without heartbeat; None: not wired
    laser_enable : its laser-enable output is in the laser's circuit; it drops with the relay
    fitted : the inputs that the cell has; the others are ignored
    shield_gas_min_L_min .. oxygen_trip_ppm : limits of the values it reads; None: not watched
    """

    period_s: Annotated[float, Field(ge=0.02, le=1)] = 0.1
    relay_timeout_s: Annotated[float, Field(ge=0.06, le=60)] | None = None
    laser_enable: Annotated[bool, Field(strict=True)] = False
    fitted: tuple[SafetyInput, ...] = SAFETY_INPUTS
    shield_gas_min_L_min: Annotated[float, Field(gt=0, le=600)] | None = None
    chiller_min_L_min: Annotated[float, Field(gt=0, le=600)] | None = None
    chiller_max_C: Annotated[float, Field(gt=0, le=100)] | None = None
    oxygen_warn_ppm: Annotated[float, Field(gt=0, le=210_000)] | None = None
    oxygen_trip_ppm: Annotated[float, Field(gt=0, le=210_000)] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> SafetySettings:
        wrong = [f"{name!r} is fitted twice" for name in sorted(_twice(list(self.fitted)))]
        if self.timeout_s is not None and self.timeout_s > self.period_s + _ROUNDING_S:
            wrong.append(f"timeout_s must be at most period_s, {self.period_s:g} s")
        if self.relay_timeout_s is not None and (
            self.relay_timeout_s < _RELAY_PERIODS * self.period_s - _ROUNDING_S
        ):
            wrong.append(
                f"relay_timeout_s must be at least {_RELAY_PERIODS} times period_s, "
                f"{_RELAY_PERIODS * self.period_s:g} s"
            )
        if self.laser_enable and self.relay_timeout_s is None:
            wrong.append(
                "laser_enable needs relay_timeout_s: the output drops with the watchdog relay"
            )
        warn_ppm, trip_ppm = self.oxygen_warn_ppm, self.oxygen_trip_ppm
        if warn_ppm is not None and trip_ppm is not None and warn_ppm > trip_ppm:
            wrong.append("oxygen_warn_ppm is above oxygen_trip_ppm")
        if "oxygen" not in self.fitted and (warn_ppm is not None or trip_ppm is not None):
            wrong.append('there are limits for oxygen, but "oxygen" is not among fitted')
        if wrong:
            raise ValueError("; ".join(wrong))
        return self


class MachineProfile(ConfigModel):
    """A whole cell. Raises ConfigError with every mistake at once when read by `load`.

    nozzle : its shape; None: what it may run into is not checked
    dilution : of its powders, by energy per length; measured ones stand in for those typed in
    mixture_catch : of powders fed together; likewise
    name : of the machine, in jobs, journals and reports
    motion, laser : the motion controller and the beam
    feeder, hopper : the powder feeders, and what is in them
    safety : the safety-input device; None where the cell has none
    scale : the catch scale; None where the cell has none
    calibration : what has been measured of the cell; None: all is as typed in
    """

    name: PlainName
    motion: MotionSettings
    laser: LaserSettings
    feeder: Annotated[tuple[FeederSettings, ...], Field(min_length=1)]
    hopper: Annotated[tuple[HopperSettings, ...], Field(min_length=1)]
    nozzle: NozzleSettings | None = None
    safety: SafetySettings | None = None
    scale: ScaleSettings | None = None
    calibration: CalibrationSettings | None = None
    dilution: Annotated[tuple[DilutionSettings, ...], Field(max_length=1000)] = ()
    mixture_catch: Annotated[tuple[MixtureCatchSettings, ...], Field(max_length=1000)] = ()
    _calibration_use: CalibrationUse | None = PrivateAttr(default=None)
    _simulated_cell: str = PrivateAttr(default="")

    @property
    def calibration_use(self) -> CalibrationUse | None:
        """Where measured values have come from; None where all are as typed in."""
        return self._calibration_use

    @property
    def simulated_cell(self) -> str:
        """Which simulated cell stands for the machine, "" where it is the machine itself."""
        return self._simulated_cell

    def as_simulated(self, cell: str) -> MachineProfile:
        """The same profile, of a simulated cell. cell : tells it from every other one"""
        profile = self.model_copy()
        profile._simulated_cell = cell
        return profile

    @property
    def purge_measuring_s(self) -> float:
        """Most time that measuring with the catch scale adds to a purge; 0 where it does not."""
        purge = None if self.scale is None else self.scale.purge
        return 0.0 if purge is None else purge.max_s

    def with_measured_values(
        self, hoppers: tuple[HopperSettings, ...], dilution: tuple[DilutionSettings, ...],
        mixture_catch: tuple[MixtureCatchSettings, ...], use: CalibrationUse,
    ) -> MachineProfile:
        """The same cell with hoppers, dilution and catch as they were measured."""
        profile = self.model_copy(update={
            "hopper": hoppers, "dilution": dilution, "mixture_catch": mixture_catch})
        profile._calibration_use = use
        return profile

    @model_validator(mode="after")
    def _consistent(self) -> MachineProfile:
        feeders = [feeder.name for feeder in self.feeder]
        wrong = [f"two feeders are called {n!r}" for n in sorted(_twice(feeders))]
        devices = [f"{feeder.endpoint}, device {feeder.device_id}" for feeder in self.feeder]
        wrong += [f"two feeders are the same device: {d}" for d in sorted(_twice(devices))]
        wrong += [
            f"two hoppers are called {n!r}" for n in sorted(_twice([h.name for h in self.hopper]))
        ]
        wrong += [
            f"hopper {h.name!r} is on feeder {h.feeder!r}, which is not there (feeders: "
            f"{', '.join(feeders)})"
            for h in self.hopper
            if h.feeder not in feeders
        ]
        places = [f"feeder {h.feeder!r} channel {h.channel}" for h in self.hopper]
        wrong += [f"two hoppers are on {place}" for place in sorted(_twice(places))]
        wrong += [
            f"hopper {h.name!r}: min_flow_g_min is not below max_flow_g_min"
            for h in self.hopper
            if h.min_flow_g_min >= h.max_flow_g_min
        ]
        relay = self.safety is not None and self.safety.relay_timeout_s is not None
        wrong += [
            f"feeder {feeder.name!r} is stopped_by_relay, and there is no safety.relay_timeout_s"
            for feeder in self.feeder
            if feeder.stopped_by_relay and not relay
        ]
        outside = [
            axis
            for axis, value in zip("xyz", self.motion.purge_mm, strict=True)
            if not getattr(self.motion.travel_mm, axis)[0] <= value
            <= getattr(self.motion.travel_mm, axis)[1]
        ]
        wrong += [f"motion.purge_mm is outside the travel in {axis}" for axis in outside]
        wrong += dilution_mistakes(self.dilution)
        if wrong:
            raise ValueError("; ".join(wrong))
        return self

    def planning_digest(self) -> str:
        """SHA-256 of what planning uses: not endpoints and safety, and not θ, τ, slope and offset,
        which a run may relearn. Measured catch efficiencies and dilutions are in it where there are
        any.

        A job planned for a profile runs on any profile of equal digest.
        """
        used = self.model_dump(
            mode="json",
            exclude={
                "motion": {"endpoint", "baud", "status_period_s"},
                "feeder": {"__all__": {
                    *ModbusDevice.model_fields, "watchdog_s", "gas_preflow_s", "stabilise_s",
                    "gas_postflow_s", "mixer_pressure_max_mbar", "correction", "map",
                    "stopped_by_relay",
                }},
                "hopper": {"__all__": {"dead_time_s", "lag_s", "slope", "offset_g_min",
                                       "powder_lot"}},
                "safety": True, "scale": True, "calibration": True,
            },
        )
        if used["nozzle"] is None:
            del used["nozzle"]
        for hopper in used["hopper"]:
            if hopper["catch_efficiency"] is None:
                del hopper["catch_efficiency"]
        for key in ("dilution", "mixture_catch"):
            if not used[key]:
                del used[key]
        return hashlib.sha256(json.dumps(used, sort_keys=True).encode()).hexdigest()


def _twice(names: list[str]) -> set[str]:
    return {name for name in names if names.count(name) > 1}


def load_profile(path: Path) -> MachineProfile:
    """Read a machine profile and its feeders' register maps. Raises ConfigError."""
    return with_device_maps(toml_file.load_toml(path, MachineProfile), path)


def with_device_maps(profile: MachineProfile, path: Path) -> MachineProfile:
    """The profile with the register maps of its feeders. path : of the profile's file.

    Raises ConfigError with every mistake of every map, and what contradicts the profile.
    """
    return profile.model_copy(
        update={"feeder": feeders_with_maps(profile.feeder, profile.hopper, path)})
