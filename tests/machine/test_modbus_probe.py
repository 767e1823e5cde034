"""A silent device is looked for: wrong id, wrong baud rate and dead cable read differently."""

import asyncio

import pytest

from lmctl.config.machine import FeederSettings, SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.manual.inspect_modbus import inspect_feeder, inspect_safety
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap, drop_chunk
from simulators.feeder.config import FeederConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.feeder_cell import TRUTH, hopper, now


def looked_at(wire, change=lambda endpoint: endpoint, device_id=1, edge=None, of="feeder"):
    """(error of a look at a device that does not answer, seconds it took)."""
    async def main():
        line = LinkTap()
        if edge is not None:
            edge(line)
        if of == "feeder":
            config = FeederConfig("F1", (TRUTH,), device_id=device_id)
            registers = FeederRegisters(PmxFeederDevice(config, now))
        else:
            registers = SimulatedSafetyDevice(SafetyConfig(device_id=device_id), now)
        server = await (
            serve_tcp(registers, edge=line) if wire == "tcp" else
            serve_pty(registers, line, checks_baud=True))
        endpoint = change(server.endpoint)
        look = (inspect_feeder(FeederSettings(name="F1", endpoint=endpoint), (hopper(),))
                if of == "feeder" else inspect_safety(SafetySettings(endpoint=endpoint)))
        started_s = now()
        with pytest.raises(MachineError) as caught:
            await look
        took_s = now() - started_s
        await asyncio.sleep(0.1)
        await server.close()
        return caught.value, took_s

    return virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("of", ["feeder", "safety"])
@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_a_wrong_id_is_named_with_the_right_one(wire, of):
    error, took_s = looked_at(wire, device_id=7, of=of)
    assert "device id 7 answers there, and id 1 was asked" in error.what
    assert "device_id = 7" in error.hint
    assert took_s < 10.0


def test_a_wrong_baud_rate_is_named_with_the_right_one():
    error, took_s = looked_at("rtu", lambda at: at.replace("baud=19200", "baud=9600"))
    assert "it answers at 19200 baud" in error.what
    assert "?baud=19200&parity=" in error.hint
    assert took_s < 12.0


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
def test_a_dead_cable_says_that_nothing_came_back(wire):
    error, took_s = looked_at(wire, edge=lambda edge: edge.add_filter("to_device", drop_chunk))
    assert "no byte came back" in error.what
    assert "answers" not in error.what.replace("does not answer", "")
    assert error.hint
    assert took_s < 15.0
