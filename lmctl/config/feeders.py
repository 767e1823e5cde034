"""The powder feeders and hoppers of a machine profile."""

from __future__ import annotations

import unicodedata
from typing import Annotated

from pydantic import AfterValidator, Field, PrivateAttr, model_validator

from firmware_protocol.device_map import DeviceMap
from lmctl.config.measuring import FeederCorrectionSettings
from lmctl.config.modbus_device import ModbusDevice
from lmctl.config.quantities import Name
from lmctl.config.toml_file import ConfigModel


def _plain(value: str) -> str:
    if any(unicodedata.category(character) == "Cc" for character in value):
        raise ValueError("holds a control character, which a terminal would obey")
    return value


#: What the cell's things are called: on one line, in messages and journals.
PlainName = Annotated[Name, AfterValidator(_plain)]

#: What a feeder's registers hold (docs/explanation/powder-delivery.md, Feeders): set-points of
#: 0.01 g/min in 16 bits.
Flow = Annotated[float, Field(ge=0, le=655)]
GasTime = Annotated[float, Field(ge=0, le=600)]
Pressure = Annotated[float, Field(gt=0, le=30_000)]

_ROUNDING_S = 1e-9

#: How often a feeder is polled within its watchdog time.
_CYCLES_PER_WATCHDOG = 4


class FeederSettings(ModbusDevice):
    """One Modbus feeder device, see `ModbusDevice` too.

    watchdog_s : the feeder stops its discs when no heartbeat comes for this time
    stabilise_s : powder counts as stable no sooner than this after its start
        (docs/explanation/safety-and-sequences.md, Sequences)
    mixer_pressure_max_mbar : more than this for a second is a clog, and holds a run; None: only the
        feeder's own alarm reports a clog. The usual pressure depends on hose, nozzle and gas, so no
        default would both spare a sound cell and detect a clog
    correction : of its hoppers' slopes during a run; None: deviations are only reported
    map : its register map: a TOML file beside the profile, or the name of one that ships; None: a
        PMX, whose word order, limits and function codes are keys of this table
    stopped_by_relay : the watchdog relay of the safety device switches the feeder off; required of
        a feeder that has no watchdog of its own
    name : by which hoppers refer to it
    gas_preflow_s, gas_postflow_s : carrier gas before and after powder
    """

    name: PlainName
    map: str | None = None
    stopped_by_relay: Annotated[bool, Field(strict=True)] = False
    watchdog_s: Annotated[float, Field(ge=0.1, le=60)] = 2.0
    gas_preflow_s: GasTime = 3.0
    stabilise_s: Annotated[float, Field(ge=0, le=600)] = 8.0
    gas_postflow_s: GasTime = 10.0
    mixer_pressure_max_mbar: Pressure | None = None
    correction: FeederCorrectionSettings | None = None
    _device_map: DeviceMap | None = PrivateAttr(default=None)

    @property
    def device_map(self) -> DeviceMap | None:
        """What `map` names, once it has been read; None for a feeder that is a PMX."""
        return self._device_map

    def with_device_map(self, device_map: DeviceMap) -> FeederSettings:
        """The same feeder with the map that its key `map` names."""
        feeder = self.model_copy()
        feeder._device_map = device_map
        return feeder

    @model_validator(mode="after")
    def _answers_within_its_cycle(self) -> FeederSettings:
        most_s = self.watchdog_s / _CYCLES_PER_WATCHDOG
        if self.timeout_s is not None and self.timeout_s > most_s + _ROUNDING_S:
            raise ValueError(f"timeout_s must be at most a quarter of watchdog_s, {most_s:g} s")
        return self


class HopperSettings(ConfigModel):
    """One hopper of a feeder and what is in it.

    channel : the hopper's number on its feeder, from 1
    dead_time_s, lag_s : θ and τ from set-point to nozzle (docs/explanation/powder-delivery.md,
    Transport delay and lag)
    slope, offset_g_min : what it really feeds is offset + slope · set-point; of a feeder that is
        calibrated itself 1 and 0
    powder_lot : of the powder in it
    catch_efficiency : measured for its powder; None: the part file's
    name : in messages and reports
    feeder : the name of the feeder it is on
    material : the name of the powder in it, as of the part file
    min_flow_g_min, max_flow_g_min : least steady and greatest flow
    carrier_L_min : its carrier gas
    """

    name: PlainName
    feeder: PlainName
    channel: Annotated[int, Field(ge=1, le=4)] = 1
    material: PlainName
    dead_time_s: Annotated[float, Field(ge=0, le=60)]
    lag_s: Annotated[float, Field(ge=0, le=60)]
    min_flow_g_min: Flow = 0.0
    max_flow_g_min: Flow
    carrier_L_min: Annotated[float, Field(gt=0, le=100)] = 4.0
    slope: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    offset_g_min: Annotated[float, Field(ge=-20, le=20)] = 0.0
    powder_lot: PlainName | None = None
    catch_efficiency: Annotated[float, Field(gt=0, le=1)] | None = None
