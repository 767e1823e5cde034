"""Restarts, alarms, silence and closed links: streams end, and it is said why."""

from __future__ import annotations

import asyncio

import pytest

from firmware_protocol.dialect import GRBL
from lmctl.errors import MachineError
from lmctl.machine.motion.status_polling import SILENCE_TIMEOUT_S
from tests.machine.motion.driving import PROGRAM, driver_events, opened, until


def test_a_restart_no_one_asked_for_stops_everything(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            device.state = "Idle"  # power, not 0x18: no alarm
            device.restart()
            taken = len(device.received)
            await asyncio.sleep(1.0)
            assert events == [("restart",)]
            assert not driver.position_trusted
            driver.submit(PROGRAM)
            await asyncio.sleep(1.0)
            assert len(device.received) == taken
            await driver.reset()
            driver.submit(PROGRAM[:4])
            await until(lambda: driver.lines_executed == 4)
            assert not driver.position_trusted
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize(("code", "kept"), [(1, False), (2, True), (3, False), (9, False)])
def test_an_alarm_stops_the_stream_and_says_whether_the_position_holds(
    controller, in_virtual_time, code, kept
):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            device.alarm(code)
            sent = driver.lines_sent
            await asyncio.sleep(10.0)
            assert events == [("alarm", code)]
            assert driver.lines_sent == sent
            assert driver.position_trusted is kept
            await driver.close()

    in_virtual_time(main())


def test_an_alarm_whose_message_was_lost_is_seen_in_the_state(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            device.mute = True
            device.alarm(1)
            device.mute = False
            await asyncio.sleep(1.0)
            assert events == [("alarm", 0)]
            assert not driver.position_trusted
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("wire", ["tcp", "pty"])
def test_silence_is_a_loss(controller, in_virtual_time, wire):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() if wire == "tcp" else device.on_pty() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.lines_executed > 3)
            device.mute = True
            loop = asyncio.get_running_loop()
            start_s = loop.time()
            await until(lambda: events)
            assert SILENCE_TIMEOUT_S - 0.2 <= loop.time() - start_s <= SILENCE_TIMEOUT_S + 0.2
            assert events == [("lost", "no answer to '?' for 3.0 s")]
            assert driver.status_age_s >= SILENCE_TIMEOUT_S - 0.1
            asked = len(device.asked_at_s)
            await asyncio.sleep(30.0)
            assert len(events) == 1
            assert len(device.asked_at_s) == asked
            with pytest.raises(MachineError, match="no answer to"):
                await driver.hold()
            with pytest.raises(MachineError, match="no answer to"):
                await driver.send_command("$G")
            await driver.close()

    in_virtual_time(main())


def test_a_closed_link_is_a_loss_and_fails_whoever_waits(controller, in_virtual_time):
    device = controller(GRBL, block_s=1.0)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            device._system = lambda line: None
            command = asyncio.create_task(driver.send_command("$G", 60.0))
            await asyncio.sleep(0.5)
            device.hang_up()
            with pytest.raises(MachineError, match="was lost"):
                await command
            await asyncio.sleep(10.0)
            ((kind, reason),) = events
            assert kind == "lost"
            assert reason.startswith(f"the link {endpoint} was lost: ")
            driver.submit([b"G1 X1"])
            assert driver.lines_sent == 0
            await driver.close()

    in_virtual_time(main())


def test_a_lost_answer_is_noticed_and_a_dwell_is_not_taken_for_one(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            device._take = lambda line, usual=device._take: b"G4" not in line and usual(line)
            driver.submit([b"G4 P60"])
            await asyncio.sleep(30.0)
            assert events == []
            await driver.reset()
            device.lose_answers.add(device._answers + 20)
            driver.submit(PROGRAM[:60])
            await until(lambda: events)
            assert events[0][0] == "lost"
            assert "1 lines are unanswered" in events[0][1]
            assert driver.lines_executed <= driver.lines_acknowledged == 59
            await driver.close()

    in_virtual_time(main())


def test_a_computer_that_slept_has_not_lost_its_controller(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = driver_events(driver)
            await asyncio.sleep(1.05)  # between two questions
            loop = asyncio.get_running_loop()
            loop._land_on(loop.time() + 100.0)
            await asyncio.sleep(1.0)
            assert events == []
            assert driver.status_age_s <= 0.1
            await driver.close()

    in_virtual_time(main())
