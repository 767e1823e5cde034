"""A simulated feeder on its link: Modbus TCP, or Modbus RTU over a pty."""

from __future__ import annotations

from collections.abc import Sequence

from simulators import modbus_server
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.readings import read_holding, read_input
from simulators.modbus_server import ModbusServer


class FeederRegisters:
    """The registers of the device as seen from the link."""

    def __init__(self, device: PmxFeederDevice) -> None:
        self._device = device

    @property
    def device_id(self) -> int:
        return self._device.config.device_id

    def read_input(self, address: int, count: int) -> list[int]:
        return read_input(self._device, address, count)

    def read_holding(self, address: int, count: int) -> list[int]:
        return read_holding(self._device, address, count)

    def write(self, address: int, words: Sequence[int]) -> None:
        self._device.write(address, words)


async def serve_tcp(device: PmxFeederDevice, host: str = "127.0.0.1",
                    port: int = 0) -> ModbusServer:
    """Serve Modbus TCP; port 0 takes a free port. Raises OSError if it cannot listen."""
    return await modbus_server.serve_tcp(FeederRegisters(device), host, port)


async def serve_pty(device: PmxFeederDevice) -> ModbusServer:
    """Answer Modbus RTU on a new pty, without parity: Linux ptys carry none."""
    return await modbus_server.serve_pty(FeederRegisters(device))
