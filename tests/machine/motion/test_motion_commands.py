"""Commands, homing and the steady beat of status questions."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from firmware_protocol.dialect import GRBL
from firmware_protocol.host import LocalProtocolError
from firmware_protocol.messages import AlarmMessage, FeedbackMessage
from lmctl.errors import MachineError
from tests.machine.motion.driving import driver_events, opened, until


def test_status_is_asked_on_a_steady_beat_and_again_where_no_answer_comes(
    controller, in_virtual_time
):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint, 0.1)
            start_s = asyncio.get_running_loop().time()
            del device.asked_at_s[:]
            await asyncio.sleep(100.05)
            beats = [at_s - start_s for at_s in device.asked_at_s]
            assert len(beats) == 1001
            assert max(abs(b - a - 0.1) for a, b in pairwise(beats[1:])) < 1e-6
            device.mute = True
            del device.asked_at_s[:]
            await asyncio.sleep(2.0)
            gaps = [b - a for a, b in pairwise(device.asked_at_s)]
            assert max(gaps) <= 0.1 + 1e-9  # asked again within a period
            assert min(gaps) >= 0.02  # and not without end
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
            assert await driver.send_command("$G") == ["[GC:G0 G55 G17 G21 G90 G94 M5 M9 T0 F0 S0]"]
            with pytest.raises(MachineError, match=r"'G99' was refused: error 20: .*supported"):
                await driver.send_command("G99")
            assert await driver.send_command("$X") == []
            assert await driver.send_command("M5") == []
            driver.submit([b"G1 X1"])
            with pytest.raises(LocalProtocolError, match="sent alone"):
                await driver.send_command("$G")
            await until(lambda: driver.lines_executed == 1)
            device._system = lambda line: None
            with pytest.raises(MachineError, match=r"no answer to .* within 5 s"):
                await driver.send_command("$G")
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("event", ["alarm", "restart", "close"])
def test_a_command_cut_short_says_why(controller, in_virtual_time, event):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            device._system = lambda line: None
            command = asyncio.create_task(driver.send_command("$H", 60.0))
            await asyncio.sleep(0.1)
            if event == "alarm":
                device.say(AlarmMessage(9))
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
            events = driver_events(driver)
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
            device.say(FeedbackMessage("MSG", "Pgm End"))
            for _ in range(2):  # one report alone may be damaged
                device.write(b"<Idle|MPos:5.000,5.000,5.000|FS:0,0|WCO:1.000,1.000,1.000>\r\n")
            for _ in range(2):
                await asyncio.sleep(0.001)
                assert driver.overrides == (100, 100, 100)
                device.write(b"<Idle|MPos:5.000,5.000,5.000|FS:0,0|Ov:60,100,100>\r\n")
            device.write(b"garbage\r\nok\r\n")
            await asyncio.sleep(0.001)
            assert driver.overrides == (60, 100, 100)
            assert driver.position_mm == (4.0, 4.0, 4.0)
            assert driver.damaged_message_count == 2
            await asyncio.sleep(0.2)
            assert driver.overrides == (60, 100, 100)  # kept: not every report carries them
            await driver.reset()
            assert driver.overrides == (100, 100, 100)
            await asyncio.sleep(0.05)
            for _ in range(2):
                device.write(b"<Idle|WPos:7.000,8.000,9.000|FS:0,0>\r\n")
            await asyncio.sleep(0.001)
            assert driver.position_mm == (7.0, 8.0, 9.0)
            await driver.close()

    in_virtual_time(main())
