"""Holds, resets, alarms, restarts and losses: what the machine does, not what was asked."""

from __future__ import annotations

import asyncio

import pytest

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.host import LocalProtocolError
from firmware_protocol.messages import Alarm, Feedback
from firmware_protocol.realtime import Realtime
from lmctl.errors import MachineError
from lmctl.machine.motion import MotionDriver, MotionListener
from lmctl.machine.status_watch import SILENT_S


async def opened(endpoint: str, period_s: float = 0.1) -> MotionDriver:
    return await MotionDriver.open(endpoint, baud=115_200, status_period_s=period_s)


async def until(condition, deadline_s: float = 60.0) -> None:
    async with asyncio.timeout(deadline_s):
        while not condition():  # noqa: ASYNC110 (the tests poll a clock that jumps)
            await asyncio.sleep(0.01)


def heard(driver: MotionDriver) -> list[tuple]:
    """Everything the driver tells but status and progress."""
    events: list[tuple] = []
    driver.listener = MotionListener(
        on_error=lambda tag, code: events.append(("error", tag, code)),
        on_alarm=lambda code: events.append(("alarm", code)),
        on_restart=lambda: events.append(("restart",)),
        on_lost=lambda reason: events.append(("lost", reason)),
    )
    return events


PROGRAM = [b"N%d G1 X%d" % (n, n % 9) for n in range(300)]


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
            await until(lambda: driver.executed > 30)
            start_s = loop.time()
            await driver.hold()
            assert 0.7 <= loop.time() - start_s < 0.8
            assert (device.state, device.sub) == ("Hold", 0)
            done, sent = device.done, driver.sent
            await asyncio.sleep(30.0)
            assert (device.done, driver.sent) == (done, sent)
            await driver.resume()
            assert device.state == "Run"
            await until(lambda: driver.executed == 300)
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
            assert (driver.sent, driver.queued) == (0, 5)
            await driver.resume()
            await until(lambda: driver.executed == 5)
            await driver.close()

    in_virtual_time(main())


def test_a_hold_that_does_not_come_is_said_within_its_deadline(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
            loop = asyncio.get_running_loop()
            device.deceleration_s = 99.0
            start_s = loop.time()
            with pytest.raises(MachineError, match=r"still moves 2\.\d"):
                await driver.hold(stopped_within_s=2.0)
            assert loop.time() - start_s < 2.1
            device._run_on()
            device._realtime = lambda byte, usual=device._realtime: (
                None if byte == Realtime.HOLD else usual(byte)
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
            await until(lambda: driver.executed > 3)
            driver.realtime(Realtime.HOLD)
            with pytest.raises(MachineError, match="not held at standstill"):
                await driver.resume()
            assert Realtime.START not in device.realtime_seen
            await driver.close()

    in_virtual_time(main())


def test_reset_from_a_hold_keeps_the_position_and_in_motion_does_not(
    controller, in_virtual_time, dialect
):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
            await driver.hold()
            report = await driver.reset()
            assert report.state == "Idle"
            assert driver.position_trusted
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
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
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
            driver.realtime(Realtime.RESET)
            await asyncio.sleep(1.0)
            assert events == []
            assert driver.queued == 0
            assert not driver.position_trusted
            await driver.close()

    in_virtual_time(main())


def test_a_restart_nobody_asked_for_stops_everything(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
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
            await until(lambda: driver.executed == 4)
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
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
            device.alarm(code)
            sent = driver.sent
            await asyncio.sleep(10.0)
            assert events == [("alarm", code)]
            assert driver.sent == sent
            assert driver.position_trusted is kept
            await driver.close()

    in_virtual_time(main())


def test_an_alarm_whose_message_was_lost_is_seen_in_the_state(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
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
            events = heard(driver)
            driver.submit(PROGRAM)
            await until(lambda: driver.executed > 3)
            device.mute = True
            loop = asyncio.get_running_loop()
            start_s = loop.time()
            await until(lambda: events)
            assert SILENT_S - 0.2 <= loop.time() - start_s <= SILENT_S + 0.2
            assert events == [("lost", "no answer to '?' for 3.0 s")]
            assert driver.status_age_s >= SILENT_S - 0.1
            asked = len(device.asked_at_s)
            await asyncio.sleep(30.0)
            assert len(events) == 1
            assert len(device.asked_at_s) == asked
            with pytest.raises(MachineError, match="no answer to"):
                await driver.hold()
            with pytest.raises(MachineError, match="no answer to"):
                await driver.command("$G")
            await driver.close()

    in_virtual_time(main())


def test_a_closed_link_is_a_loss_and_fails_whoever_waits(controller, in_virtual_time):
    device = controller(GRBL, block_s=1.0)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            device._system = lambda line: None
            command = asyncio.create_task(driver.command("$G", 60.0))
            await asyncio.sleep(0.5)
            device.hang_up()
            with pytest.raises(MachineError, match="was lost"):
                await command
            await asyncio.sleep(10.0)
            ((kind, reason),) = events
            assert kind == "lost"
            assert reason.startswith(f"the link {endpoint} was lost: ")
            driver.submit([b"G1 X1"])
            assert driver.sent == 0
            await driver.close()

    in_virtual_time(main())


def test_a_lost_answer_is_noticed_and_a_dwell_is_not_taken_for_one(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
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
            assert driver.executed <= driver.acknowledged == 59
            await driver.close()

    in_virtual_time(main())


def test_status_is_asked_on_a_steady_beat_with_one_question_open(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint, 0.1)
            start_s = asyncio.get_running_loop().time()
            del device.asked_at_s[:]
            await asyncio.sleep(100.05)
            beats = [at_s - start_s for at_s in device.asked_at_s]
            assert len(beats) == 1001
            assert max(abs(b - n * 0.1) for n, b in enumerate(beats)) < 1e-6
            device.mute = True  # now each open question is waited for before the next
            del device.asked_at_s[:]
            await asyncio.sleep(2.0)
            gaps = [b - a for a, b in zip(device.asked_at_s, device.asked_at_s[1:], strict=False)]
            assert min(gaps) >= 0.5 - 1e-9
            assert 1.9 <= driver.status_age_s <= 2.1
            device.mute = False
            await asyncio.sleep(1.0)
            assert driver.status_age_s <= 0.1
            await driver.close()

    in_virtual_time(main())


def test_commands_answer_in_words(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert await driver.command("$G") == ["[GC:G0 G55 G17 G21 G90 G94 M5 M9 T0 F0 S0]"]
            with pytest.raises(MachineError, match=r"'G99' was refused: error 20: .*supported"):
                await driver.command("G99")
            assert await driver.command("$X") == []
            assert await driver.command("M5") == []
            driver.submit([b"G1 X1"])
            with pytest.raises(LocalProtocolError, match="sent alone"):
                await driver.command("$G")
            await until(lambda: driver.executed == 1)
            device._system = lambda line: None
            with pytest.raises(MachineError, match=r"no answer to .* within 5 s"):
                await driver.command("$G")
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("event", ["alarm", "restart", "close"])
def test_a_command_cut_short_says_why(controller, in_virtual_time, event):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            device._system = lambda line: None
            command = asyncio.create_task(driver.command("$H", 60.0))
            await asyncio.sleep(0.1)
            if event == "alarm":
                device.say(Alarm(9))
            elif event == "restart":
                device.restart()
            else:
                await driver.close()
            words = {"alarm": "alarm 9: no limit switch", "restart": "restarted",
                     "close": "the link was closed"}
            with pytest.raises(MachineError, match=words[event]):
                await command
            await driver.close()

    in_virtual_time(main())


def test_homing_may_be_long_and_silent(controller, in_virtual_time):
    device = controller(GRBL, settings={22: "1"})

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            work = device._system

            def home(line: bytes) -> None:
                device.mute = True

                def arrived() -> None:
                    device.mute = False
                    work(line)

                asyncio.get_running_loop().call_later(60.0, arrived)

            device._system = home
            await driver.home()
            assert events == []
            assert driver.position_trusted
            await asyncio.sleep(5.0)
            assert driver.status_age_s <= 0.1
            await driver.close()

    in_virtual_time(main())


def test_push_messages_overrides_and_offsets_are_followed(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert driver.overrides == (100, 100, 100)
            await asyncio.sleep(0.05)  # between two questions
            device.say(Feedback("MSG", "Pgm End"))
            device.write(b"<Idle|MPos:5.000,5.000,5.000|FS:0,0|WCO:1.000,1.000,1.000>\r\n")
            device.write(b"<Idle|MPos:5.000,5.000,5.000|FS:0,0|Ov:60,100,100>\r\n")
            device.write(b"garbage\r\nok\r\n")
            await asyncio.sleep(0.01)
            assert driver.overrides == (60, 100, 100)
            assert driver.position_mm == (4.0, 4.0, 4.0)
            assert driver.damaged_messages == 2
            await asyncio.sleep(0.2)
            assert driver.overrides == (60, 100, 100)  # kept: not every report carries them
            await driver.reset()
            assert driver.overrides == (100, 100, 100)
            await asyncio.sleep(0.05)
            device.write(b"<Idle|WPos:7.000,8.000,9.000|FS:0,0>\r\n")
            await asyncio.sleep(0.01)
            assert driver.position_mm == (7.0, 8.0, 9.0)
            await driver.close()

    in_virtual_time(main())


def test_a_computer_that_slept_has_not_lost_its_controller(controller, in_virtual_time):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            events = heard(driver)
            await asyncio.sleep(1.05)  # between two questions
            loop = asyncio.get_running_loop()
            loop._land_on(loop.time() + 100.0)
            await asyncio.sleep(1.0)
            assert events == []
            assert driver.status_age_s <= 0.1
            await driver.close()

    in_virtual_time(main())
