"""Orders that only take something away are repeated until they are seen to work."""

import asyncio

import pytest

from lmctl.errors import MachineError
from simulators import virtual_time
from simulators.modbus_errors import ExceptionReplyError
from tests.machine.feeder_cell import disc_rpm, driven, feeding, now, simulated

PASSING = (5, 6, 10, 11)


class Gateway:
    """Answers every request to a device by an exception until a time."""

    def __init__(self, server, code: int, for_s: float) -> None:
        self.asked = 0
        self._registers, self._server = server.registers, server
        self._code, self._until_s = code, now() + for_s
        self.device_id = server.registers.device_id
        server.registers = self

    def _passes(self):
        if now() < self._until_s:
            self.asked += 1
            raise ExceptionReplyError(self._code)
        return self._registers

    def read_input(self, address, count):
        return self._passes().read_input(address, count)

    def read_holding(self, address, count):
        return self._passes().read_holding(address, count)

    def write(self, address, words):
        self._passes().write(address, words)


async def until_still_s(device) -> float:
    """Time until the disc is told to stand."""
    started_s = now()
    while True:
        device.advance_to_now()
        if not device.discs_on:
            return now() - started_s
        await asyncio.sleep(0.01)


@pytest.mark.parametrize("code", PASSING)
@pytest.mark.parametrize("stops_by", ["stop_powder", "stop_gas", "close"])
def test_a_hopper_stops_as_soon_as_the_gateway_lets_an_order_through(code, stops_by):
    async def main():
        async with driven() as (driver, device, server, _):
            await feeding(driver)
            Gateway(server, code, 0.9)
            stopping = asyncio.create_task(getattr(driver, stops_by)())
            fed_on_s = await until_still_s(device)
            await stopping
            return fed_on_s

    assert 0.9 <= virtual_time.run_in_virtual_time(main()) <= 1.05


@pytest.mark.parametrize("lost", ["request", "answer"])
def test_an_order_that_gets_lost_is_given_again(lost):
    async def main():
        async with driven() as (driver, device, server, _):
            await feeding(driver)
            direction = "to_device" if lost == "request" else "to_host"

            def lose(data, deliver):
                server.edge.remove_filter(direction, lose)

            server.edge.add_filter(direction, lose)
            started_s = now()
            await driver.stop_powder()
            assert disc_rpm(device) < 0.1 or not device.discs_on
            return now() - started_s

    assert virtual_time.run_in_virtual_time(main()) < 1.2


def test_gas_off_without_post_flow_is_given_again_too():
    async def main():
        async with driven() as (driver, device, server, _):
            await feeding(driver)
            Gateway(server, 11, 0.9)
            started_s = now()
            await driver.stop_gas(post_flow=False)
            assert not device.is_gas_flowing(now())
            return now() - started_s

    assert virtual_time.run_in_virtual_time(main()) < 2.0


def test_a_device_that_never_lets_go_is_reported_with_the_reason():
    async def main():
        async with driven() as (driver, _, server, _):
            await feeding(driver)
            Gateway(server, 11, 60.0)
            with pytest.raises(MachineError, match=r"powder did not stop within \d s: its gateway"):
                await driver.stop_powder()

    virtual_time.run_in_virtual_time(main())


def test_an_order_is_given_again_even_after_no_one_waits_for_it():
    """A gateway that loses commands and passes everything else: the cycle itself repeats them."""
    async def main():
        async with driven() as (driver, device, server, _):
            await feeding(driver)
            registers, until_s = server.registers, now() + 8.0

            class LosesCommands(Gateway):
                def write(self, address, words):
                    if address == 0 and now() < until_s:
                        raise ExceptionReplyError(11)
                    registers.write(address, words)

            LosesCommands(server, 11, 0.0)
            with pytest.raises(MachineError, match="powder did not stop within 5 s"):
                await driver.stop_powder()
            assert device.discs_on
            return await until_still_s(device)

    assert virtual_time.run_in_virtual_time(main()) < 3.6


@pytest.mark.parametrize("code", PASSING)
def test_a_passing_exception_is_a_lost_answer_and_no_fault(code):
    async def main():
        async with driven() as (driver, _, server, ears):
            await feeding(driver)
            Gateway(server, code, 0.9)  # two answers of a feeder asked every 0.5 s
            await asyncio.sleep(5.0)
            assert ears.faults == []
            assert driver.status_age_s <= driver.period_s
            gateway = Gateway(server, code, 2.0)  # and four of them are silence
            await asyncio.sleep(3.0)
            (fault,) = ears.faults
            assert fault.startswith("no answer for 1.5 s")
            assert f"(Modbus exception {code:02d}), {gateway.asked - 1} times" in fault

    virtual_time.run_in_virtual_time(main())


def test_the_first_heartbeat_differs_from_the_one_an_earlier_host_left():
    """A device counts only a change as a heartbeat."""
    from lmctl.config.machine import FeederSettings
    from lmctl.machine.feeder.driver import FeederDriver
    from tests.machine.feeder_cell import ONE, hopper

    async def main():
        async with simulated(ONE) as (device, server):
            device.holding.set_raw_word("HEARTBEAT", 1)
            before_s = device.heartbeat_s
            await asyncio.sleep(1.0)
            driver = await FeederDriver.open(
                FeederSettings(name="F1", endpoint=server.endpoint), (hopper(),))
            assert device.holding.raw_word("HEARTBEAT") == 2
            assert device.heartbeat_s > before_s
            await driver.close()

    virtual_time.run_in_virtual_time(main())
