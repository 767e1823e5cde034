"""Devices that number, order and limit their registers in their own way, and a server built on
another library: driven with the right keys, refused with the key that mends it without them."""

import asyncio
from contextlib import asynccontextmanager

import pytest
from pydantic import ValidationError
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from firmware_protocol.registers import WordOrder
from lmctl.config.machine import FeederSettings, SafetySettings
from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.manual.inspect_modbus import inspect_feeder, inspect_safety
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.feeder.config import FeederConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_errors import ExceptionReplyError
from simulators.modbus_quirks import ModbusQuirks
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.feeder_cell import TRUTH, hopper, now

ORDERS = [order.value for order in WordOrder]
#: Quirks of a device, and the keys of a profile that say so.
HABITS = [
    (ModbusQuirks(), {}),
    (ModbusQuirks(address_base=1), {"address_base": 1}),
    (ModbusQuirks(max_registers=28), {"max_registers": 28}),
    (ModbusQuirks(function_codes=(3, 4, 16)), {"function_codes": (3, 4, 16)}),
    (ModbusQuirks(function_codes=(3, 16)), {"function_codes": (3, 16)}),
    (ModbusQuirks(1, 28, (3, 16)),
     {"address_base": 1, "max_registers": 28, "function_codes": (3, 16)}),
]


@asynccontextmanager
async def another_library(registers):
    """The same registers behind pymodbus's own server."""
    device_id = registers.device_id

    async def action(code, start, address, count, current, written):
        try:
            if written is not None:
                registers.write(address, written)
            else:
                read = registers.read_input if code == 4 else registers.read_holding
                current[address - start : address - start + count] = read(address, count)
        except ExceptionReplyError as refused:
            return ExcCodes(refused.code)
        return None

    data = SimData(0, count=2000, values=0, datatype=DataType.REGISTERS)
    device = SimDevice(id=device_id, simdata=[data], action=action)
    server = ModbusTcpServer(device, address=("127.0.0.1", 0))
    await server.listen()
    try:
        yield f"modbus-tcp://127.0.0.1:{server.transport.sockets[0].getsockname()[1]}"
    finally:
        await server.shutdown()


@asynccontextmanager
async def served(registers, wire, quirks=None):
    if wire == "pymodbus":
        async with another_library(registers) as endpoint:
            yield endpoint
        return
    serve = serve_tcp if wire == "tcp" else serve_pty
    keywords = {} if wire == "tcp" else {"baud": 115_200}
    server = await serve(registers, quirks=quirks, **keywords)
    try:
        yield server.endpoint
    finally:
        await server.close()


async def feed_a_while(registers, wire, quirks=None, **keys):
    async with served(registers, wire, quirks) as endpoint:
        driver = await FeederDriver.open(FeederSettings(name="F1", endpoint=endpoint, **keys),
                                         (hopper(),))
        await driver.start_gas()
        driver.set_flows({"A": 6.0})
        await driver.start_powder()
        await driver.wait_until_stable(30.0)
        await asyncio.sleep(5.0)
        status = driver.status
        await driver.stop_powder()
        await driver.stop_gas()
        await driver.close()
        return status


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
@pytest.mark.parametrize(("quirks", "keys"), HABITS)
def test_a_feeder_with_quirks_is_driven_with_their_keys(quirks, keys, wire):
    async def main():
        device = PmxFeederDevice(FeederConfig("F1", (TRUTH,)), now)
        status = await feed_a_while(FeederRegisters(device), wire, quirks, **keys)
        assert status.hoppers["A"].flow_estimated_g_min == pytest.approx(6.0, abs=0.02)
        assert not device.discs_on

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("order", ORDERS)
def test_a_feeder_with_any_word_order_is_driven_with_its_key(order):
    async def main():
        config = FeederConfig("F1", (TRUTH,), word_order=WordOrder(order))
        device = PmxFeederDevice(config, now)
        status = await feed_a_while(FeederRegisters(device), "tcp", word_order=order)
        left_g = device.hoppers[1].process.remaining_g(now())
        assert left_g < status.hoppers["A"].weight_g < left_g + 10.0
        assert status.uptime_s < 100

    virtual_time.run_in_virtual_time(main())


def test_the_same_through_a_server_of_another_library():
    async def main():
        device = PmxFeederDevice(FeederConfig("F1", (TRUTH,)), now)
        status = await feed_a_while(FeederRegisters(device), "pymodbus")
        assert status.hoppers["A"].flow_estimated_g_min == pytest.approx(6.0, abs=0.02)
        config = SafetyConfig(watchdog_relay=True, laser_enable=True)
        async with served(SimulatedSafetyDevice(config, now), "pymodbus") as endpoint:
            driver = await SafetyDriver.open(
                SafetySettings(endpoint=endpoint, relay_timeout_s=0.3, laser_enable=True))
            await driver.reset_watchdog_relay()
            driver.request_laser_enable(True)
            await driver.wait_for_laser_enable(True)
            await asyncio.sleep(2.0)
            assert driver.fault is None
            assert driver.status_age_s <= 0.1 + 1e-6
            driver.request_laser_enable(False)
            await driver.wait_for_laser_enable(False)
            await driver.close()

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize(("uptime_s", "configured", "true_order"), [
    (uptime_s, configured, true_order)
    for uptime_s in (0.0, 299.4, 65_535.5, 200_000.0)
    for configured in ORDERS for true_order in ORDERS if configured != true_order
])
def test_swapped_words_are_refused_with_the_key_that_mends_it(uptime_s, configured, true_order):
    async def main():
        config = FeederConfig("F1", (TRUTH,), word_order=WordOrder(true_order))
        device = PmxFeederDevice(config, now)
        safety = SimulatedSafetyDevice(SafetyConfig(word_order=WordOrder(true_order)), now)
        device.powered_s = safety._powered_s = now() - uptime_s
        async with (
            served(FeederRegisters(device), "tcp") as feeder_at, served(safety, "tcp") as safety_at
        ):
            feeder = FeederSettings(name="F1", endpoint=feeder_at, word_order=configured)
            for opening in (
                FeederDriver.open(feeder, (hopper(),)), inspect_feeder(feeder, (hopper(),)),
                SafetyDriver.open(SafetySettings(endpoint=safety_at, word_order=configured)),
                inspect_safety(SafetySettings(endpoint=safety_at, word_order=configured)),
            ):
                with pytest.raises(MachineError, match="in another word order") as caught:
                    await opening
                assert f'word_order = "{true_order}"' in caught.value.hint

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("uptime_s", [0.0, 299.4, 65_535.5, 200_000.0])
@pytest.mark.parametrize("order", ORDERS)
def test_no_word_order_that_is_right_is_refused(order, uptime_s):
    async def main():
        config = FeederConfig("F1", (TRUTH,), word_order=WordOrder(order))
        device = PmxFeederDevice(config, now)
        device.powered_s = now() - uptime_s
        async with served(FeederRegisters(device), "tcp") as endpoint:
            feeder = FeederSettings(name="F1", endpoint=endpoint, word_order=order)
            look = await inspect_feeder(feeder, (hopper(),))
            assert look.status.uptime_s == pytest.approx(uptime_s + now(), abs=1.0)

    virtual_time.run_in_virtual_time(main())


def test_a_device_that_counts_from_one_is_refused_with_the_key_that_mends_it():
    async def main():
        feeder = FeederRegisters(PmxFeederDevice(FeederConfig("F1", (TRUTH,)), now))
        safety = SimulatedSafetyDevice(SafetyConfig(), now)
        async with (
            served(_Shifted(feeder), "tcp") as feeder_at, served(_Shifted(safety), "tcp") as at
        ):
            for opening in (
                FeederDriver.open(FeederSettings(name="F1", endpoint=feeder_at), (hopper(),)),
                SafetyDriver.open(SafetySettings(endpoint=at)),
            ):
                with pytest.raises(MachineError) as caught:
                    await opening
                assert "address_base = 1" in caught.value.hint

    virtual_time.run_in_virtual_time(main())


class _Shifted:
    """Registers one later than the map says, with something in register 0."""

    def __init__(self, registers) -> None:
        self.device_id, self._registers = registers.device_id, registers

    def read_input(self, address, count):
        return [0, *self._registers.read_input(0, count - 1)]


@pytest.mark.parametrize(("keys", "words"), [
    ({"function_codes": (4, 23)}, "cannot be driven without 3 and 16"),
    ({"word_order": "BCDA"}, "CDAB"), ({"address_base": 2}, "1"), ({"max_registers": 0}, "1"),
    ({"function_codes": (3, 5, 16)}, "23"),
])
def test_keys_out_of_range_are_refused(keys, words):
    with pytest.raises(ValidationError, match=words):
        ModbusDevice(endpoint="modbus-tcp://h", **keys)


def test_a_time_out_longer_than_the_cycle_is_refused():
    with pytest.raises(ValidationError, match=r"at most a quarter of watchdog_s, 0.5 s"):
        FeederSettings(name="F1", endpoint="modbus-tcp://h", timeout_s=0.6)
    with pytest.raises(ValidationError, match=r"at most period_s, 0.1 s"):
        SafetySettings(endpoint="modbus-tcp://h", timeout_s=0.2)


def test_fewer_registers_than_a_recipe_takes_are_refused():
    async def main():
        device = PmxFeederDevice(FeederConfig("F1", (TRUTH,)), now)
        async with served(FeederRegisters(device), "tcp") as endpoint:
            with pytest.raises(MachineError, match="moves 20 registers") as caught:
                await FeederDriver.open(
                    FeederSettings(name="F1", endpoint=endpoint, max_registers=20), (hopper(),))
            assert "max_registers" in caught.value.hint

    virtual_time.run_in_virtual_time(main())
