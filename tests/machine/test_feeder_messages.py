"""What a person is told of a feeder that does not do what it was ordered to."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import pytest

from firmware_protocol.pmx import (
    PMX_MAP,
    FeederCommandBits,
    FeederStateCode,
    FeederStatusBits,
    HopperStatusBits,
)
from lmctl.config.machine import FeederSettings, SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.manual.inspect_modbus import inspect_feeder, inspect_safety
from simulators import virtual_time
from simulators.modbus_errors import ExceptionReplyError
from simulators.modbus_server import serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from tests.error_facts import assert_states
from tests.machine.feeder_cell import ONE, driven, hopper, simulated

Forge = Callable[[int], int]
Refuse = Callable[[str, int], int]


def register(name: str) -> int:
    return PMX_MAP.wire_address(name)


class Forged:
    """Changes words of a device's answers, by register, and commands on their way to it.

    refuse : the exception code, 0 for none, by "read" or "write" and the address
    """

    def __init__(
        self, server, words: Mapping[int, Forge] = MappingProxyType({}), *,
        command: Forge = lambda word: word, refuse: Refuse = lambda *_: 0,
    ) -> None:
        self._registers, self._words = server.registers, words
        self._command, self._refuse = command, refuse
        self.device_id = server.registers.device_id
        server.registers = self

    def _ask(self, act: str, address: int) -> None:
        if code := self._refuse(act, address):
            raise ExceptionReplyError(code)

    def read_input(self, address: int, count: int) -> list[int]:
        self._ask("read", address)
        return [self._words[address + at](word) if address + at in self._words else word
                for at, word in enumerate(self._registers.read_input(address, count))]

    def read_holding(self, address: int, count: int) -> list[int]:
        self._ask("read", address)
        return self._registers.read_holding(address, count)

    def write(self, address: int, words: Sequence[int]) -> None:
        self._ask("write", address)
        if address == register("COMMAND"):
            words = [self._command(words[0]), *words[1:]]
        self._registers.write(address, words)


#: Of the first map: status and hoppers are read as input registers, without a mirror.
FIRST_MAP = replace(ONE, map_minor=0)


def without(bits: int) -> Forge:
    return lambda word: word & ~int(bits)


def with_bits(bits: int) -> Forge:
    return lambda word: word | int(bits)


def local(server, device) -> None:
    device.set_local_mode(True)


def unlisted_reason(server, device) -> None:
    Forged(server, {register("LAST_REFUSAL"): lambda _: 99})
    device.set_local_mode(True)


def no_gas(server, device) -> None:
    device.is_gas_ok = lambda _: False


def no_powder(server, device) -> None:
    device.config = replace(device.config, preflow_s=1000.0)


def unstable(server, device) -> None:
    Forged(server, {register("STATUS"): without(FeederStatusBits.STABLE)})


def deaf(server, device) -> None:
    """It answers, and what it was commanded to do first is all that it ever does."""
    commanded = int(FeederCommandBits.ENABLE_REMOTE | FeederCommandBits.GAS_ON)
    Forged(server, command=lambda _: commanded)


def never_freezes(server, device) -> None:
    Forged(server, command=without(FeederCommandBits.REFILL_HOLD))


def stays_frozen(server, device) -> None:
    Forged(server, {register("H1.STATUS"): with_bits(HopperStatusBits.REFILLING)})


def shaken(server, device) -> None:
    more = itertools.cycle((0, 400, 150, 700))
    Forged(server, {register("H1.WEIGHT") + 1: lambda word: word + next(more)})


def hoppers_unread(server, device) -> None:
    """The hopper is answered for once more, so that its weighing is seen to go on."""
    left = itertools.chain([0] * 1, itertools.repeat(6))
    hopper_status = register("H1.STATUS")
    Forged(server, refuse=lambda act, at: next(left) if at == hopper_status else 0)


def flows_on(server, device) -> None:
    Forged(server, {register("STATE"): lambda _: int(FeederStateCode.STOPPING)})


def commands_refused(server, device) -> None:
    Forged(server, refuse=never_commanded)


def alarmed(server, device) -> None:
    Forged(server, {register("FIRST_ALARM_CODE"): lambda _: 101,
                    register("STATUS"): with_bits(FeederStatusBits.ALARM)})


def never_commanded(act: str, address: int) -> int:
    return 4 if (act, address) == ("write", register("COMMAND")) else 0


async def reset_what_is_seen(driver: FeederDriver) -> None:
    await asyncio.sleep(3.0)
    await driver.reset_alarms()


ACTS = {
    "gas": lambda driver: driver.start_gas(),
    "powder": lambda driver: driver.start_powder(),
    "stable": lambda driver: driver.wait_until_stable(5.0),
    "gas off": lambda driver: driver.stop_gas(),
    "gas off at once": lambda driver: driver.stop_gas(post_flow=False),
    "reset": lambda driver: driver.reset_alarms(),
    "seen and reset": reset_what_is_seen,
    "open": lambda driver: driver.open_hopper("A"),
    "close": lambda driver: driver.close_hopper("A"),
}


@pytest.mark.parametrize(
    ("before", "spoil", "act", "facts"),
    [
        ((), local, "gas", ("it refuses to start gas", "LOCAL", "own display")),
        ((), unlisted_reason, "gas", ("reason 99", "register map does not list")),
        (("gas",), local, "powder", ("it refuses to start powder", "LOCAL")),
        ((), no_gas, "gas", ("carrier gas did not come within", "its state is")),
        (("gas",), no_powder, "powder", ("powder did not start within",)),
        (("gas", "powder"), unstable, "stable", ("powder did not get stable within 5 s",)),
        (("gas",), deaf, "gas off", ("gas did not stop within",)),
        (("gas",), flows_on, "gas off", ("gas did not stop within",)),
        (("gas",), flows_on, "gas off at once", ("gas did not stop within",)),
        (("open",), shaken, "close", ("weight of hopper A does not settle", "close the lid")),
        (("open",), hoppers_unread, "close", ("hopper A was not read within 5 s",)),
        ((), commands_refused, "reset", ("it refuses to take commands",)),
        ((), commands_refused, "open", ("it refuses to freeze its weighing",)),
        ((), alarmed, "seen and reset", ("its alarms did not clear within",)),
        (("gas",), never_freezes, "open", ("hopper A did not become free of pressure",)),
        (("open",), stays_frozen, "close", ("its weighing did not go on",)),
    ],
)
def test_an_order_that_does_not_come_about(
    before: tuple[str, ...], spoil: Callable[..., None], act: str, facts: tuple[str, ...]
) -> None:
    async def main() -> None:
        async with driven(FIRST_MAP) as (driver, device, server, _):
            driver.set_flows({"A": 6.0})
            for earlier in before:
                await ACTS[earlier](driver)
            spoil(server, device)
            with pytest.raises(MachineError) as refused:
                await ACTS[act](driver)
            assert_states(refused.value, "feeder F1: ", *facts)

    virtual_time.run_in_virtual_time(main())


def once_read() -> Refuse:
    """What it is can be read, and nothing after that."""
    reads = itertools.chain([0], itertools.repeat(4))
    return lambda act, address: next(reads) if (act, address) == ("read", 0) else 0


@pytest.mark.parametrize(
    ("refuse", "words", "facts"),
    [
        (once_read, {}, ("it refuses to show its status", "see the feeder's own display")),
        (lambda: never_commanded, {}, ("it refuses to take commands",)),
        (lambda: lambda *_: 4, {}, ("cannot do this in its present state", "LOCAL")),
        (lambda: lambda *_: 0, {"STATE": lambda _: 77},
         ("its answer makes no sense", "is it a PMX?")),
    ],
)
def test_a_feeder_that_cannot_be_opened(
    refuse: Callable[[], Refuse], words: dict[str, Forge], facts: tuple[str, ...]
) -> None:
    async def main() -> None:
        async with simulated(FIRST_MAP) as (_, server):
            Forged(server, {register(name): forge for name, forge in words.items()},
                   refuse=refuse())
            with pytest.raises(MachineError) as told:
                await FeederDriver.open(
                    FeederSettings(name="F1", endpoint=server.endpoint), [hopper()])
            assert_states(told.value, *facts)

    virtual_time.run_in_virtual_time(main())


def test_a_feeder_that_falls_silent_before_its_hoppers_are_known() -> None:
    async def main() -> None:
        async with driven(FIRST_MAP) as (driver, _, server, _):
            server.go_offline()
            with pytest.raises(MachineError, match="its hoppers were not read within") as told:
                await driver.complete_status()
            assert told.value.hint

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize(
    ("refuse", "words", "facts"),
    [
        (lambda *_: 4, {}, ("feeder F1: it cannot do this", "LOCAL")),
        (lambda *_: 0, {"STATE": lambda _: 77}, ("feeder F1: its answer makes no sense", "PMX?")),
    ],
)
def test_a_feeder_that_cannot_be_looked_at(
    refuse: Refuse, words: dict[str, Forge], facts: tuple[str, ...]
) -> None:
    async def main() -> None:
        async with simulated(FIRST_MAP) as (_, server):
            Forged(server, {register(name): forge for name, forge in words.items()}, refuse=refuse)
            with pytest.raises(MachineError) as told:
                await inspect_feeder(
                    FeederSettings(name="F1", endpoint=server.endpoint), [hopper()])
            assert_states(told.value, *facts)

    virtual_time.run_in_virtual_time(main())


def test_a_safety_device_that_cannot_be_looked_at() -> None:
    async def main() -> None:
        device = SimulatedSafetyDevice(SafetyConfig(), asyncio.get_running_loop().time)
        server = await serve_tcp(device)
        Forged(server, refuse=lambda *_: 4)
        with pytest.raises(MachineError, match="safety device: it cannot do this") as told:
            await inspect_safety(SafetySettings(endpoint=server.endpoint))
        assert "device 1" in told.value.where[0]
        assert told.value.hint
        await server.close()

    virtual_time.run_in_virtual_time(main())
