"""Modbus disturbances, ridden out.

hopper_stops_after_exceptions_s : a hopper is told to stop while its gateway answers every request
    by exception 05, 06, 0A or 0B for 0.9 s; longest time until its disc is told to stand, counted
    from the end of the exceptions
half_open_worst_age_periods : oldest answer of a safety device whose connection becomes half open at
    20 moments, in periods of which three are silence
rtu_answers_found_of_100 : answers found behind stray bytes and an echo, device id 1
"""

from __future__ import annotations

import asyncio

from lmctl.config.modbus_device import ModbusDevice
from lmctl.machine.modbus.client import ModbusLink, NoReplyError
from simulators import virtual_time
from simulators.faults.filters import ExactEcho, ModbusExceptions, StrayBytes
from simulators.faults.link_tap import LinkTap
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_server import serve_pty
from tests.machine.feeder_cell import ONE, driven, feeding, now
from tests.machine.safety_cell import PERIOD_S
from tests.machine.safety_cell import driven as safety_driven

_EXCEPTIONS_S = 0.9
_CODES = (5, 6, 10, 11)


def rows() -> dict[str, float | int]:
    """Every row of this group."""
    return {
        "hopper_stops_after_exceptions_s": round(
            max(virtual_time.run_in_virtual_time(_stop_s(code)) for code in _CODES), 3),
        "half_open_worst_age_periods":
            round(virtual_time.run_in_virtual_time(_half_open_age_s()) / PERIOD_S, 2),
        "rtu_answers_found_of_100": virtual_time.run_in_virtual_time(_found_behind_noise()),
    }


async def _stop_s(code: int) -> float:
    async with driven() as (driver, device, server, _):
        await feeding(driver)
        edge = server.edge
        one = ModbusExceptions(code, float("inf"), edge.is_rtu, edge.send_to_host, lambda: None)
        edge.add_filter("to_device", one)
        stopping = asyncio.create_task(driver.stop_powder())
        await asyncio.sleep(_EXCEPTIONS_S)
        edge.remove_filter("to_device", one)
        freed_s = now()
        device.advance_to_now()
        while device.discs_on:
            await asyncio.sleep(0.005)
            device.advance_to_now()
        stopped_s = now() - freed_s
        await stopping
        return stopped_s


async def _half_open_age_s() -> float:
    edge, oldest_s = LinkTap(), 0.0
    async with safety_driven(edge=edge) as (driver, _, _):
        for at in range(20):
            await asyncio.sleep(0.5 + 0.013 * at)
            edge.make_connections_half_open()
            for _ in range(60):
                await asyncio.sleep(0.005)
                oldest_s = max(oldest_s, driver.status_age_s)
    return oldest_s


async def _found_behind_noise() -> int:
    edge = LinkTap()
    server = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)), edge)
    edge.add_filter("to_device", ExactEcho(edge.send_to_host))
    edge.add_filter("to_host", StrayBytes(3))
    link = await ModbusLink.open(
        ModbusDevice(endpoint=server.endpoint, device_id=1), timeout_s=0.2)
    found = 0
    for _ in range(100):
        try:
            found += list(await link.read_input(0, 1)) == [0x504D]
        except NoReplyError:
            continue
    await link.close()
    await server.close()
    return found
