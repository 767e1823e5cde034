"""A simulated feeder, its clock, and a host that writes to it."""

from __future__ import annotations

import pytest

from firmware_protocol.pmx import (
    PMX_MAP,
    FeederCommandBits,
    FeederStateCode,
    FeederStatusBits,
    hopper_register_name,
    recipe_register_names,
    register_map,
)
from firmware_protocol.registers import RegisterSpace
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.readings import read_holding, read_input
from simulators.modbus_errors import ExceptionReplyError

REMOTE = FeederCommandBits.ENABLE_REMOTE
GAS = REMOTE | FeederCommandBits.GAS_ON
FEED = GAS | FeederCommandBits.FEED_ON


def hopper(channel: int = 1, **changes) -> HopperConfig:
    settings = {
        "channel": channel, "material": "316L", "density_g_mm3": 0.008, "catch_efficiency": 0.7,
        "dead_time_s": 3.0, "lag_s": 1.0, "feed_factor_g_rev": 2.0, "n_min_rpm": 0.3,
        "n_max_rpm": 20.0, "fill_g": 1000.0,
    }
    return HopperConfig(**{**settings, **changes})


class Cell:
    """A device, its clock, and the host's habits."""

    def __init__(self, *hoppers: HopperConfig, **settings) -> None:
        self.t = 100.0
        config = FeederConfig("F1", hoppers or (hopper(),), **settings)
        self.device = PmxFeederDevice(config, lambda: self.t)
        self.n = len(config.hoppers)
        self.beats = 0

    def wait(self, seconds: float, *, beating: bool = True) -> None:
        """Let time pass; a beating host writes its heartbeat four times a second."""
        end = self.t + seconds
        while beating and self.t + 0.25 < end:
            self.t += 0.25
            self.beat()
        self.t = end

    def beat(self) -> None:
        self.beats += 1
        self.write("HEARTBEAT", self.beats)

    def write(self, name: str, value) -> None:
        self.device.write(PMX_MAP.wire_address(name), PMX_MAP.encode(name, value))

    def refused(self, name: str, value) -> int:
        with pytest.raises(ExceptionReplyError) as caught:
            self.write(name, value)
        return caught.value.code

    def recipe(self, *flows_g_min: float, seq: int, ramp_s: float = 0.0, **more) -> None:
        """One write from HEARTBEAT to the last shadow register."""
        self.beats += 1
        table = register_map(self.n)
        values = dict.fromkeys(recipe_register_names(self.n), 0)
        values |= {"HEARTBEAT": self.beats, "WD_TIMEOUT": 1000, "WD_ACTION": 1, "SEQ": seq,
                   "RAMP": ramp_s, "STABILISE": 8.0, "POSTFLOW": 10.0, "SETPOINT_MODE": 1,
                   "AT_SPEED_TOL": 2.0}
        for channel, flow in enumerate(flows_g_min, 1):
            values[hopper_register_name(channel, "FLOW_SP")] = flow
            values[hopper_register_name(channel, "CARRIER_SP")] = 4.0
        block = table.contiguous_block(recipe_register_names(self.n))
        self.device.write(block.address, block.encode(values | more))

    def read(self, name: str):
        row = PMX_MAP[name]
        read = read_input if row.space is RegisterSpace.INPUT else read_holding
        return PMX_MAP.decode(name, read(self.device, PMX_MAP.wire_address(name), row.word_count))

    @property
    def state(self) -> FeederStateCode:
        return FeederStateCode(self.read("STATE"))

    @property
    def status(self) -> FeederStatusBits:
        return FeederStatusBits(self.read("STATUS"))

    def feed(self, *flows_g_min: float) -> None:
        """Take command and run powder until it is stable."""
        self.write("COMMAND", REMOTE)
        self.recipe(*flows_g_min, seq=1)
        self.write("COMMAND", FEED)
        self.wait(11.5)
        assert self.state is FeederStateCode.FEEDING

    def disc_rpm(self, channel: int = 1) -> float:
        return self.read(hopper_register_name(channel, "DISC_ACT"))
