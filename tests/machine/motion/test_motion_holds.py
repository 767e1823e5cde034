"""Hold, resume and reset: standstill is waited for, and nothing is lost but what must be."""

from __future__ import annotations

import asyncio

import pytest

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.realtime import RealtimeCommand
from lmctl.errors import MachineError
from tests.machine.motion.driving import PROGRAM, driver_events, opened, until


@pytest.mark.parametrize("wire", ["tcp", "serial"])
def test_hold_waits_for_standstill_and_resume_goes_on_with_nothing_lost(
    controller, in_virtual_time, dialect, wire
):
    device = controller(dialect)
    device.deceleration_s = 0.7

    async def main() -> None:
        async with device.on_tcp() if wire == "tcp" else device.on_pty(wire) as endpoint:
            loop = asyncio.get_running_loop()
            driver = await opened(endpoint)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 30)
            start_s = loop.time()
            await driver.hold()
            assert 0.7 <= loop.time() - start_s < 0.8
            assert (device.state, device.sub) == ("Hold", 0)
            done, sent = device.done, driver.lines_sent
            await asyncio.sleep(30.0)
            assert (device.done, driver.lines_sent) == (done, sent)
            await driver.resume()
            assert device.state == "Run"
            await until(lambda: driver.lines_executed == 300)
            assert driver.position_trusted
            await driver.close()

    in_virtual_time(main())
    assert [line for line in device.received if line[:1] != b"$"] == PROGRAM


def test_hold_at_rest_returns_and_lines_wait_for_resume(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            await driver.hold()
            driver.submit(PROGRAM[:5])
            await asyncio.sleep(1.0)
            assert (driver.lines_sent, driver.lines_queued) == (0, 5)
            await driver.resume()
            await until(lambda: driver.lines_executed == 5)
            await driver.close()

    in_virtual_time(main())


def test_a_hold_that_does_not_come_is_said_within_its_deadline(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            loop = asyncio.get_running_loop()
            device.deceleration_s = 99.0
            start_s = loop.time()
            with pytest.raises(MachineError, match=r"position has not changed for [12]\.\d"):
                await driver.hold(stopped_within_s=2.0)
            assert loop.time() - start_s < 2.1
            device.report = lambda usual=device.report: usual()._replace(
                machine_mm=(loop.time(), 0.0, 0.0))
            with pytest.raises(MachineError, match=r"still moves 2\.\d"):
                await driver.hold(stopped_within_s=2.0)
            device._run_on()
            device._realtime = lambda byte, usual=device._realtime: (
                None if byte == RealtimeCommand.HOLD else usual(byte)
            )
            start_s = loop.time()
            with pytest.raises(MachineError, match=r"no hold showed within 0\.\d"):
                await driver.hold()
            assert loop.time() - start_s < 0.3
            await driver.close()

    in_virtual_time(main())


def test_resume_is_refused_while_it_still_decelerates(controller, in_virtual_time):
    device = controller(GRBL)
    device.deceleration_s = 3.0

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            driver.send_realtime(RealtimeCommand.HOLD)
            with pytest.raises(MachineError, match="not held at standstill"):
                await driver.resume()
            assert RealtimeCommand.START not in device.realtime_seen
            await driver.close()

    in_virtual_time(main())


def test_a_hold_that_does_not_end_and_a_restart_into_silence_are_told(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            await driver.hold()
            device._realtime = lambda byte, usual=device._realtime: (
                None if byte == RealtimeCommand.START else usual(byte))
            with pytest.raises(MachineError, match="the hold did not end within") as held:
                await driver.resume()
            assert "safety door" in held.value.hint
            device._realtime = lambda byte, usual=device._realtime: (
                None if byte == RealtimeCommand.STATUS else usual(byte))
            with pytest.raises(MachineError, match=r"restarted but answers no '\?'") as deaf:
                await driver.reset(1.0)
            assert deaf.value.hint == "switch it off and on"
            await driver.close()

    in_virtual_time(main())


def test_reset_from_a_hold_keeps_the_position_and_in_motion_does_not(
    controller, in_virtual_time, dialect
):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            await driver.hold()
            report = await driver.reset()
            assert report.state == "Idle"
            assert driver.position_trusted
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            report = await driver.reset()
            assert report.state == ("Alarm" if dialect is GRBL else "Idle")
            assert not driver.position_trusted
            assert events == ([("alarm", 3)] if dialect is GRBL else [])
            await driver.close()

    in_virtual_time(main())


def test_a_bare_reset_byte_is_no_surprise_and_ends_the_stream(controller, in_virtual_time):
    device = controller(GRBLHAL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            driver.send_realtime(RealtimeCommand.RESET)
            await asyncio.sleep(1.0)
            assert events == []
            assert driver.lines_queued == 0
            assert not driver.position_trusted
            await driver.close()

    in_virtual_time(main())
