"""The driver against the simulated controller, which plans ahead and moves as the firmwares do."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import numpy as np
import pytest

from firmware_protocol.realtime import RealtimeCommand
from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver
from simulators.motion.config import MotionConfig
from simulators.motion.server import open_pty, serve_tcp
from simulators.motion.simulator import MotionSimulator

SETTINGS = {30: 1000, 32: 1, 110: 6000, 111: 6000, 112: 6000, 120: 500, 121: 500, 122: 500,
            130: 300, 131: 300, 132: 200}


@asynccontextmanager
async def machine(name: str, wire: str, rx_bytes: int | None = None, **settings: float):
    """A simulated controller and a driver that has met it."""
    mask = 3 if name == "grbl" else 511
    wanted = SETTINGS | {10: mask} | {int(key[1:]): value for key, value in settings.items()}
    sim = MotionSimulator(MotionConfig(dialect=name, rx_bytes=rx_bytes, settings=wanted))
    if wire == "tcp":
        server = await serve_tcp(sim)
        endpoint = f"tcp://127.0.0.1:{server.port}"
    else:
        server = open_pty(sim)
        endpoint = f"{wire}://{server.path}"
    driver = None
    try:
        driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
        yield sim, driver
    finally:
        if driver is not None:
            await driver.close()
        server.close()
        sim.close()
        await asyncio.sleep(0)


def rings(turns: int, steps: int = 40) -> list[bytes]:
    """Circles of short moves, with beam, that begin and end in laser-off travel."""
    lines = [b"N0 G21 G90 G94", b"N1 M4 S0", b"N2 G1 X60 Y50 F6000 S0"]
    for turn in range(turns):
        angles = 2 * np.pi * np.arange(1, steps + 1) / steps
        for x, y in zip(50 + 10 * np.cos(angles), 50 + 10 * np.sin(angles), strict=True):
            lines.append(b"N%d G1 X%.3f Y%.3f F1200 S%d" % (len(lines), x, y, 500 + turn))
    lines.append(b"N%d G1 X5 Y5 F6000 S0" % len(lines))
    lines.append(b"N%d M5" % len(lines))
    return lines


every_wire = pytest.mark.parametrize("wire", ["tcp", "pty", "serial"])
both_dialects = pytest.mark.parametrize("name", ["grbl", "grblhal"])


async def executed_all(driver: MotionDriver, deadline_s: float = 600.0) -> None:
    async with asyncio.timeout(deadline_s):
        while driver.lines_executed < driver.lines_sent or driver.lines_queued:  # noqa: ASYNC110
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("name", ["grbl", "grblhal"])
@pytest.mark.parametrize(("wire", "rx_bytes"), [("tcp", None), ("tcp", 128), ("tcp", 1024),
                                                ("pty", 128), ("pty", 1024), ("serial", None)])
def test_a_program_is_executed_once_whole_and_followed(in_virtual_time, name, wire, rx_bytes):
    lines = rings(5)

    async def main() -> None:
        async with machine(name, wire, rx_bytes) as (sim, driver):
            assert driver.identity.is_bench
            leads = []

            def progressed() -> None:
                done = sim.executed_line_numbers
                true = done[-1] + 1 if done else 2
                true += done[-1:] == [len(lines) - 2]  # M5 is done with the last motion
                leads.append(driver.lines_executed - true)
                assert driver.lines_executed <= driver.lines_acknowledged <= driver.lines_sent

            driver.listener = MotionCallbacks(on_progress=progressed)
            for start in range(0, len(lines), 17):
                driver.submit(lines[start : start + 17])
            await executed_all(driver)
            assert driver.lines_sent == driver.lines_executed == len(lines)
            assert sim.executed_line_numbers == list(range(2, len(lines) - 1))
            assert sim.rx_overrun_bytes == 0
            assert driver.damaged_message_count == 0
            assert sim.position_mm[:2] == pytest.approx((5.0, 5.0))
            assert driver.position_mm[:2] == pytest.approx((5.0, 5.0))
            assert max(leads) <= 0  # never called executed before it was
            assert np.mean(leads) > -3  # and known soon after

    in_virtual_time(main())


@both_dialects
@every_wire
def test_hold_and_resume_on_the_way_lose_nothing(in_virtual_time, name, wire):
    lines = rings(3)

    async def main() -> None:
        async with machine(name, wire) as (sim, driver):
            driver.submit(lines)
            for _ in range(4):
                await asyncio.sleep(1.3)
                await driver.hold()
                at, executed = sim.position_mm, driver.lines_executed
                assert driver.status.state == "Hold"
                await asyncio.sleep(5.0)
                assert sim.position_mm == at
                assert driver.lines_executed == executed
                await driver.resume()
            await executed_all(driver)
            assert sim.executed_line_numbers == list(range(2, len(lines) - 1))
            assert driver.position_trusted

    in_virtual_time(main())


@both_dialects
@every_wire
def test_cancel_from_a_hold_keeps_the_place_and_another_stream_runs(in_virtual_time, name, wire):
    async def main() -> None:
        async with machine(name, wire) as (sim, driver):
            driver.submit(rings(5))
            await asyncio.sleep(3.0)
            await driver.hold()
            at = sim.position_mm
            report = await driver.reset()
            assert report.state == "Idle"
            assert driver.position_trusted
            assert driver.position_mm == pytest.approx(at, abs=0.0006)
            done = len(sim.executed_line_numbers)
            driver.submit(rings(1))
            assert driver.lines_executed == 0
            await executed_all(driver)
            assert len(sim.executed_line_numbers) - done >= 40
            assert sim.rx_overrun_bytes == 0

    in_virtual_time(main())


@every_wire
def test_a_reset_in_motion_loses_the_position(in_virtual_time, wire):
    async def main() -> None:
        async with machine("grbl", wire) as (_, driver):
            alarms = []
            driver.listener.on_alarm = alarms.append
            driver.submit(rings(5))
            await asyncio.sleep(2.0)
            report = await driver.reset()
            assert report.state == "Alarm"
            assert alarms == [3]
            assert not driver.position_trusted
            with pytest.raises(MachineError, match="error 9: the controller is locked"):
                await driver.send_command("G0 X0")

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_rejected_line_stops_the_machine_near_it(in_virtual_time, name, wire):
    lines = rings(5)
    lines[100] = b"N100 G1 X1 X2"

    async def main() -> None:
        async with machine(name, wire) as (sim, driver):
            errors = []
            driver.listener.on_error = lambda tag, code: errors.append((tag, code))
            driver.submit(lines)
            await asyncio.sleep(30.0)
            assert errors == [(100, 25)]
            assert driver.status.state == "Hold"
            assert driver.lines_executed <= driver.lines_acknowledged == 100
            assert max(sim.executed_line_numbers, default=0) < 130

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_feed_override_is_followed(in_virtual_time, name, wire):
    async def main() -> None:
        async with machine(name, wire) as (_, driver):
            driver.submit(rings(3))
            await asyncio.sleep(1.0)
            driver.send_realtime(RealtimeCommand.FEED_MINUS_10)
            await asyncio.sleep(0.5)
            assert driver.overrides == (90, 100, 100)
            await executed_all(driver)
            assert driver.overrides == (90, 100, 100)

    in_virtual_time(main())


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"s32": 0}, "laser mode is off"), ({"s10": 1}, "could not be distinguished")],
)
@both_dialects
@every_wire
def test_settings_no_program_may_run_with(in_virtual_time, name, wire, settings, words):
    async def main() -> None:
        async with machine(name, wire, None, **settings) as (sim, driver):
            with pytest.raises(MachineError, match=words):
                driver.submit(rings(1))
            await asyncio.sleep(2.0)
            assert not any(sim.executed_line_numbers)

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_machine_taken_over_in_a_hold_is_where_it_was(in_virtual_time, name, wire):
    """A host that dies in a hold: the next one finds the place before it resets anything."""

    async def main() -> None:
        async with machine(name, wire) as (sim, driver):
            driver.submit(rings(5))
            await asyncio.sleep(2.0)
            await driver.hold()
            at = sim.position_mm
            endpoint = driver._connection.endpoint
            await driver.close()
            heir = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            assert heir.first_report.state == "Hold"
            assert heir.first_report.machine_mm == pytest.approx(at, abs=0.0006)
            assert heir.status.state == "Idle"
            assert heir.position_mm == pytest.approx(at, abs=0.0006)
            heir.submit(rings(1))
            await executed_all(heir)
            await heir.close()

    in_virtual_time(main())


@every_wire
def test_homing_and_soft_limits(in_virtual_time, wire):
    async def main() -> None:
        async with machine("grbl", wire, None, s22=1, s20=1) as (_, driver):
            assert not driver.position_trusted
            await driver.home()
            assert driver.position_trusted
            alarms = []
            driver.listener.on_alarm = alarms.append
            driver.submit([b"G1 X900 F600"])
            await asyncio.sleep(2.0)
            assert alarms == [2]
            assert driver.position_trusted
            assert driver.lines_executed == 0

    in_virtual_time(main())


def test_a_second_client_is_turned_away_and_reported(in_virtual_time):
    async def main() -> None:
        async with machine("grblhal", "tcp") as (_, driver):
            with pytest.raises(MachineError, match="lost") as refused:
                await MotionDriver.open(
                    driver._connection.endpoint, baud=115_200, status_period_s=0.1
                )
            assert "no other program uses it" in refused.value.hint

    in_virtual_time(main())
