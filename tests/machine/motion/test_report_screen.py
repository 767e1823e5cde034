"""Which reports are believed, and what a changed digit can do: nothing."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import parse_status
from lmctl.machine.motion.identity import ControllerIdentity
from lmctl.machine.motion.override_arithmetic import NO_OVERRIDE, overrides_after_byte
from lmctl.machine.motion.status_report_filter import StatusReportFilter
from tests.machine.motion.driving import opened, until

SETTINGS = {110: "6000", 111: "6000", 112: "600"}


@pytest.fixture
def screen() -> StatusReportFilter:
    """Of a controller with 15 blocks and 128 bytes, that moves 100 mm/s, and 10 mm/s in Z."""
    made = StatusReportFilter()
    made.set_controller_info(ControllerIdentity(GRBL, "1.1h.20190830", "", 128, 15), SETTINGS)
    return made


def taken(screen: StatusReportFilter, *texts: str, period_s: float = 0.2) -> list[bool]:
    """Whether each report is believed, one a period."""
    believed = []
    for at, text in enumerate(texts):
        report = parse_status(f"<{text}>")
        assert report is not None
        believed.append(screen.believed_report(report, 10.0 + at * period_s) is not None)
    return believed


def test_a_machine_at_rest_is_believed_when_it_says_the_same_twice(screen):
    here, there = "Idle|MPos:1.000,2.000,3.000", "Idle|MPos:1.000,2.000,8.000"
    assert taken(screen, here, here, here, there, here, there, there) == [
        False, True, True, False, True, False, True]


@pytest.mark.parametrize(("sound", "garbled"), [
    ("Hold:1|MPos:1.000,2.000,3.000", "Hold:0|MPos:1.000,2.000,3.000"),
    ("Run|MPos:1.000,2.000,3.000", "Run|MPos:1.000,2.000,9.000"),  # Z is slow
    ("Run|MPos:1.000,2.000,3.000", "Run|MPos:61.000,2.000,3.000"),
    ("Run|MPos:1.000,2.000,3.000|Bf:10,100", "Run|MPos:1.000,2.000,3.000|Bf:90,100"),
    ("Run|MPos:1.000,2.000,3.000|Bf:10,100", "Run|MPos:1.000,2.000,3.000|Bf:10,900"),
    ("Run|MPos:1.000,2.000,3.000", "Run|FS:600,500"),  # its place is not readable
    ("Idle|MPos:1.000,2.000,3.000|Bf:15,128", "Idle|MPos:1.000,2.000,3.000|Bf:10,128"),
    ("Alarm:1|MPos:1.000,2.000,3.000", "Alarm:9|MPos:1.000,2.000,3.000"),
])
def test_one_report_that_a_machine_cannot_have_sent_is_held_back(screen, sound, garbled):
    taken(screen, sound, sound)
    assert taken(screen, garbled, sound, garbled, sound) == [False, True, False, True]


def test_what_looks_impossible_is_believed_when_another_report_agrees(screen):
    taken(screen, "Run|MPos:1.000,2.000,3.000")
    assert taken(screen, *3 * ["Run|MPos:91.000,2.000,3.000"]) == [False, True, True]


@given(st.lists(st.sampled_from([RealtimeCommand.FEED_PLUS_10, RealtimeCommand.FEED_MINUS_1,
                                 RealtimeCommand.FEED_100,
                                 RealtimeCommand.SPINDLE_MINUS_10, RealtimeCommand.RAPID_25,
                                 RealtimeCommand.STATUS])))
@settings(max_examples=30)
def test_overrides_that_were_commanded_are_believed_at_once(sent):
    screen, expected = StatusReportFilter(), NO_OVERRIDE
    for byte in sent:
        screen.on_realtime_sent(byte)
        expected = overrides_after_byte(byte, expected)
    taken(screen, *2 * ["Idle|MPos:0.000,0.000,0.000|Ov:{},{},{}".format(*expected)])
    assert screen.overrides == expected
    assert not screen.is_unsure


def test_overrides_and_offsets_that_no_one_commanded_are_believed_when_said_twice(screen):
    screen.set_work_offset((0.0, 0.0, 0.0))
    taken(screen, "Run|MPos:0.000,0.000,0.000|Ov:180,100,100|WCO:0.000,9.000,0.000")
    assert screen.is_unsure
    taken(screen, "Run|MPos:0.000,0.000,0.000|Ov:100,100,100|WCO:0.000,0.000,0.000")
    assert not screen.is_unsure  # a changed digit
    assert screen.overrides == NO_OVERRIDE
    at = "Run|MPos:0.000,0.000,0.000|Ov:180,100,100|WCO:0.000,9.000,0.000"
    reports = [screen.believed_report(parse_status(f"<{at}>"), 20.0 + n) for n in range(2)]
    assert reports[0].override_percents is reports[0].offset_mm is None
    assert reports[1].override_percents == (180, 100, 100)
    assert reports[1].offset_mm == (0.0, 9.0, 0.0)


def test_homing_is_believed_whatever_fields_are_added_and_not_for_one_changed_digit(
    controller, in_virtual_time
):
    async def main(homed: int, changed: int) -> bool:
        """changed : which full report has the other digit, 0 for none"""
        device, asked = controller(GRBLHAL, settings={22: "1"}), []

        def report(usual=device.report):
            said = homed if len(asked) != changed or not changed else 1 - homed
            return usual()._replace(unknown_fields=(("AR", None), ("$C", "1"), ("H", str(said))))

        def realtime(byte, usual=device._realtime) -> None:
            if byte == RealtimeCommand.STATUS_FULL:
                asked.append(byte)
                byte = RealtimeCommand.STATUS
            usual(byte)

        device.report, device._realtime = report, realtime
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert len(asked) >= max(2, changed)
            trusted = driver.position_trusted
            await driver.close()
            return trusted

    for homed in (0, 1):
        for changed in (0, 1, 2):
            assert in_virtual_time(main(homed, changed)) is bool(homed)


def test_a_question_lost_in_a_reset_is_put_again_at_once(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint, 1.0)
            loop = asyncio.get_running_loop()
            answer, device.mute = device._realtime, False
            device._realtime = lambda byte: None if byte == RealtimeCommand.STATUS else answer(byte)
            await asyncio.sleep(1.5)  # a question is open
            device._realtime = answer
            start_s = loop.time()
            report = await driver.reset()
            assert report.state == "Idle"
            assert loop.time() - start_s < 0.05
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("field", [b"Ln:", b"Bf:"])
def test_one_changed_digit_counts_no_line_as_executed(controller, in_virtual_time, field):
    dialect = GRBLHAL if field == b"Ln:" else GRBL
    device = controller(dialect, block_s=0.5)
    wrong = b"Ln:9|" if field == b"Ln:" else b"Bf:15,"

    def changed(data: bytes) -> bytes:
        head, _, rest = data.partition(field)
        separator = b"|" if field == b"Ln:" else b","
        return head + wrong + rest.partition(separator)[2] if rest else data

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            far, every = device.write, []

            def write(data: bytes) -> None:
                if data.startswith(b"<Run"):
                    every.append(None)
                    if len(every) % 3 == 0:
                        data = changed(data)
                far(data)

            device.write = write
            driver.submit([b"N%d G1 X%d F600" % (n, n) for n in range(1, 12)])
            claimed = []
            driver.listener.on_progress = lambda: claimed.append((driver.lines_executed,
                                                                  device.done))
            await until(lambda: driver.lines_executed == 11)
            assert all(reported <= done for reported, done in claimed), claimed
            assert len(every) > 20
            await driver.close()

    in_virtual_time(main())
