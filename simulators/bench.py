"""The assembled simulated cell: a motion controller and its feeders, each on its own link."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping
from contextlib import AsyncExitStack
from dataclasses import replace
from types import TracebackType

import numpy as np

from firmware_protocol.device_map import DeviceMap
from simulators.array_types import FloatArray
from simulators.bench_config import Address, BenchConfig
from simulators.bench_record import BenchRecord
from simulators.faults.link_tap import LinkTap
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.mapped_device import MappedFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_quirks import ModbusQuirks, ModbusRegisters
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.motion import server as motion_server
from simulators.motion.simulator import MotionSimulator
from simulators.safety.device import SimulatedSafetyDevice
from simulators.safety.wiring import SafetyWiring
from simulators.scale.device import SimulatedCatchScale

_ANY_PORT = Address("127.0.0.1", 0)
_SAFETY_BAUD = 115_200  # the host polls it ten times a second or more


class Bench:
    """A cell on the running loop, from entering to leaving.

    ephemeral_ports : take free ports of 127.0.0.1 in place of those configured
    maps : register maps of feeders that are no PMX, by name
    relay_feeders : names of those whose drives the safety device's relay switches off
    endpoints : by "motion", "safety", "scale" and the feeders' names, in the spelling of a machine
        profile
    motion, feeders, safety, scale : the devices themselves, for a caller that acts as the operator
    edges : by the names of the endpoints, where faults apply to a device's bytes
    Entering raises OSError, which names the device, if a port is in use.

    >>> async def cell(config):
    ...     async with Bench(config, ephemeral_ports=True) as bench:
    ...         return sorted(bench.endpoints)
    """

    def __init__(
        self, config: BenchConfig, *, ephemeral_ports: bool = False,
        maps: Mapping[str, DeviceMap] | None = None, relay_feeders: Collection[str] = (),
    ) -> None:
        self.config = config
        self._maps = dict(maps or {})
        self._relay_feeders = frozenset(relay_feeders)
        self._ephemeral_ports = ephemeral_ports
        self._running = AsyncExitStack()
        self.endpoints: dict[str, str] = {}
        self.feeders: dict[str, PmxFeederDevice] = {}
        self.safety: SimulatedSafetyDevice | None = None
        self.scale: SimulatedCatchScale | None = None
        self.edges: dict[str, LinkTap] = {}

    async def __aenter__(self) -> Bench:
        try:
            await self._start()
        except BaseException:
            await self._running.aclose()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await self._running.aclose()

    @property
    def record(self) -> BenchRecord:
        """The record of the run so far; also available after leaving."""
        return BenchRecord(self.motion.trace, list(self.feeders.values()))

    async def _start(self) -> None:
        clock = asyncio.get_running_loop().time
        self.motion = MotionSimulator(self.config.motion)
        self._running.callback(self.motion.close)
        self.endpoints["motion"] = await self._serve_motion(self._address("motion"))
        for feeder in self.config.feeders:
            device_map = self._maps.get(feeder.name)
            if device_map is not None and device_map.feeder is not None:
                feeder = replace(feeder, has_watchdog=device_map.feeder.has_watchdog)
            device = PmxFeederDevice(feeder, clock)
            self.feeders[feeder.name] = device
            registers: ModbusRegisters = FeederRegisters(device)
            units: dict[int, ModbusRegisters] = {}
            quirks = None
            if device_map is not None:
                by_unit = MappedFeederDevice(device, device_map).units()
                registers = by_unit.pop(None)
                units = {one.device_id: one for one in by_unit.values()}
                quirks = ModbusQuirks(0, device_map.max_registers, device_map.function_codes)
            self.endpoints[feeder.name] = await self._serve_modbus(
                f"feeder {feeder.name}", registers, self._edge(feeder.name),
                self._address(feeder.name), quirks=quirks, units=units,
            )
        if self.config.safety is not None:
            self.safety = SimulatedSafetyDevice(self.config.safety, clock)
            wiring = SafetyWiring(
                self.safety, self.motion, self.feeders.values(),
                [one for name, one in self.feeders.items() if name in self._relay_feeders])
            self._running.callback(wiring.close)
            self.endpoints["safety"] = await self._serve_modbus(
                "safety", self.safety, self._edge("safety"), self._address("safety"), _SAFETY_BAUD
            )

        if self.config.scale is not None:
            self.scale = SimulatedCatchScale(self.config.scale, clock, self._caught_flow_g_s)
            self.endpoints["scale"] = await self._serve_modbus(
                "scale", self.scale, self._edge("scale"), self._address("scale"))

    def _caught_flow_g_s(self, time_s: FloatArray) -> FloatArray:
        """What leaves the nozzle with the beam off, which falls onto the scale: (n,) [g/s]."""
        flow = np.zeros_like(time_s)
        for feeder in self.feeders.values():
            for hopper in feeder.hoppers.values():
                flow += hopper.process.nozzle_flow_g_s(time_s)
        sample, scale = self.motion.trace.sample(time_s), self.config.scale
        misses = sample.power_fraction > 0
        if scale is not None and scale.reach_mm > 0:
            aside = sample.position_mm[:, :2] - [scale.x_mm, scale.y_mm]
            misses |= np.hypot(aside[:, 0], aside[:, 1]) > scale.reach_mm
        return np.where(misses, 0.0, flow)

    def _address(self, name: str) -> Address:
        address = self.config.addresses[name]
        return _ANY_PORT if self._ephemeral_ports and not address.pty else address

    async def _serve_motion(self, address: Address) -> str:
        if address.pty:
            pty = motion_server.open_pty(self.motion, self._edge("motion"))
            self._running.callback(pty.close)
            return f"pty://{pty.path}"
        try:
            server = await motion_server.serve_tcp(
                self.motion, address.host, address.port, self._edge("motion")
            )
        except OSError as error:
            raise _taken("motion", address, error) from error
        self._running.callback(server.close)
        return f"tcp://{address.host}:{server.port}"

    def _edge(self, name: str) -> LinkTap:
        return self.edges.setdefault(name, LinkTap())

    async def _serve_modbus(
        self, name: str, device: ModbusRegisters, edge: LinkTap, address: Address,
        baud: int = 19_200, quirks: ModbusQuirks | None = None,
        units: Mapping[int, ModbusRegisters] | None = None,
    ) -> str:
        if address.pty:
            server = await serve_pty(device, edge, baud, quirks, units=units)
        else:
            try:
                server = await serve_tcp(
                    device, address.host, address.port, edge, quirks, units)
            except OSError as error:
                raise _taken(name, address, error) from error
        self._running.push_async_callback(server.close)
        return server.endpoint


def with_motion_on_pty(config: BenchConfig) -> BenchConfig:
    """Return the same cell with its motion controller on a new pty."""
    return replace(config, addresses={**config.addresses, "motion": Address(pty=True)})


def _taken(name: str, address: Address, error: OSError) -> OSError:
    reason = error.strerror or str(error)
    return OSError(f"{name} cannot listen on {address.host}:{address.port}: {reason}")
