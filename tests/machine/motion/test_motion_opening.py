"""Meeting a controller: what is refused, in which words, and what is learnt."""

from __future__ import annotations

import asyncio

import pytest

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.realtime import RealtimeCommand
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import ControllerIdentity, parse_work_offset, unsuitable_settings


async def opened(endpoint: str, timeout_s: float = 5.0) -> MotionDriver:
    return await MotionDriver.open(
        endpoint, baud=115_200, status_period_s=0.1, connect_timeout_s=timeout_s
    )


def refusal(run, device, wire: str = "tcp") -> MachineError:
    """The error that opening ends with; no other must escape."""

    async def main() -> None:
        async with device.on_tcp() if wire == "tcp" else device.on_pty(wire) as endpoint:
            await opened(endpoint)

    with pytest.raises(MachineError) as refused:
        run(main())
    assert refused.value.hint
    return refused.value


def refused_program(run, device) -> MachineError:
    """The error that the first line of a program ends with; nothing may have been sent."""

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            try:
                driver.submit([b"N0 G21 G90 G94"])
            finally:
                assert driver.lines_sent == driver.lines_queued == 0
                await driver.close()

    with pytest.raises(MachineError) as refused:
        run(main())
    return refused.value


@pytest.mark.parametrize("wire", ["tcp", "pty", "serial"])
def test_a_controller_says_who_it_is(controller, in_virtual_time, dialect, wire):
    device = controller(dialect, settings={30: "500"})

    async def main() -> None:
        async with device.on_tcp() if wire == "tcp" else device.on_pty(wire) as endpoint:
            driver = await opened(endpoint)
            assert driver.identity.dialect is dialect
            assert driver.identity.version == dialect.version
            assert driver.identity.rx_bytes == dialect.rx_bytes
            assert driver.identity.planner_blocks == dialect.planner_blocks
            assert driver.identity.is_bench
            assert driver.settings[30] == "500"
            assert driver.first_report.state == "Idle"
            assert driver.offset_mm == (1.0, 2.0, 3.75)  # G55 + G92 + TLO
            assert driver.position_mm == (-1.0, -2.0, -3.75)
            assert driver.status_age_s < 0.1
            assert (driver.lines_sent, driver.lines_acknowledged, driver.lines_executed) == (0, 0,
                                                                                             0)
            await driver.close()
            await driver.close()

    in_virtual_time(main())


def test_another_machine_is_not_the_bench(controller, in_virtual_time):
    async def main() -> None:
        async with controller(GRBL, info="").on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert not driver.identity.is_bench
            await driver.close()

    in_virtual_time(main())


def test_nothing_is_sent_before_an_answer_and_never_a_bare_newline(controller, in_virtual_time):
    """A half line left by a dead host must not be executed by ours; it only costs an error."""
    device = controller(GRBL)
    device.device.receive_data(b"G99 X1")  # and `$I` behind it is no command

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert driver.identity.version == GRBL.version
            await driver.close()

    in_virtual_time(main())
    assert device.received == [b"G99 X1$I", b"$I", b"$$", b"$G", b"$#"]


def test_a_board_that_resets_when_the_port_opens_is_waited_for(controller, in_virtual_time):
    device = controller(GRBL)
    device.mute = True

    async def main() -> None:
        async with device.on_pty("serial") as endpoint:
            loop = asyncio.get_running_loop()

            def booted() -> None:
                device.mute = False
                device.restart()

            loop.call_later(2.0, booted)
            driver = await opened(endpoint)
            assert 2.0 <= loop.time() < 2.5
            driver.submit([b"G1 X1"])
            await asyncio.sleep(1.0)
            assert driver.lines_executed == 1
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("value", ["0", "2", None])
def test_with_laser_mode_off_no_line_is_sent(controller, in_virtual_time, dialect, value):
    device = controller(dialect)
    device.settings = {n: v for n, v in device.settings.items() if n != 32}
    if value is not None:
        device.settings[32] = value
    error = refused_program(in_virtual_time, device)
    assert "laser mode is off" in error.what
    assert "M4 would leave the beam on at standstill" in error.what
    assert "lmctl machine doctor" in error.hint


@pytest.mark.parametrize(
    ("firmware", "mask", "mend"),
    [(GRBL, "1", 3), (GRBL, "0", 2), (GRBLHAL, "1", 71), (GRBLHAL, "505", 511), (GRBL, "junk", 2)],
)
def test_with_reports_that_show_no_progress_no_line_is_sent(
    controller, in_virtual_time, firmware, mask, mend
):
    device = controller(firmware)
    device.report = lambda: controller(firmware).report()  # mask may be no number here
    device.settings[10] = mask
    error = refused_program(in_virtual_time, device)
    assert "executed lines could not be distinguished from planned ones" in error.what
    identity = ControllerIdentity(firmware, "1.1f", "", 128, 15)
    (unfit,) = unsuitable_settings(identity, {10: mask, 32: "1"})
    assert (unfit.number, unfit.value) == (10, mend)


def test_silence(controller, in_virtual_time):
    device = controller(GRBL)
    device.mute = True
    assert "silent" in refusal(in_virtual_time, device).what
    assert "silent" in refusal(in_virtual_time, device, "pty").what


def test_a_wrong_baud_rate_or_another_device_answers_but_not_as_grbl(controller, in_virtual_time):
    device = controller(GRBL)
    device.feed = lambda data: device.write(b"\xf8\x80\x00HTTP/1.1 400 Bad Request\r\n")
    error = refusal(in_virtual_time, device)
    assert "not a Grbl controller" in error.what
    assert "baud" in error.hint


@pytest.mark.parametrize(
    ("version", "options", "words"),
    [("0.9j.20160316", "V,15,128", "is not Grbl 1.1"), ("1.1h", "V", "does not state the size"),
     ("1.1h", "V,15,x", "does not state the size"), ("1.1h", "V,15,7", "not credible"),
     ("1.1h", "V,0,128", "not credible")],
)
def test_other_firmwares(controller, in_virtual_time, version, options, words):
    device = controller(GRBL)
    said = f"[VER:{version}:]\r\n[OPT:{options}]\r\nok\r\n".encode()
    work = device._system
    device._system = lambda line: device.write(said) if line == b"$I" else work(line)
    error = refusal(in_virtual_time, device)
    assert words in f"{error.what} {error.hint}"


def test_no_controller_in_its_place(in_virtual_time):
    async def main(endpoint: str) -> None:
        await opened(endpoint)

    for endpoint, words in [
        ("tcp://127.0.0.1:9", "nothing listens"),
        ("serial:///dev/does-not-exist", "does not exist"),
    ]:
        with pytest.raises(MachineError) as refused:
            in_virtual_time(main(endpoint))
        assert words in refused.value.what
        assert endpoint in refused.value.where[0]
    with pytest.raises(ConfigError):
        in_virtual_time(main("udp://127.0.0.1:9"))


def test_a_machine_in_motion_is_waited_for_and_refused_when_it_goes_on(
    controller, in_virtual_time, dialect
):
    device = controller(dialect, block_s=0.4)

    async def main(lines: int) -> MotionDriver:
        async with device.on_tcp() as endpoint:
            device.feed(b"G1 X1\n" * lines)  # another host's, which died
            driver = await opened(endpoint, 3.0)
            assert driver.first_report.state == "Run"
            assert driver.status.state == "Idle"
            await driver.close()

    in_virtual_time(main(4))
    with pytest.raises(MachineError, match="moving"):
        in_virtual_time(main(12))


def test_a_machine_found_holding_is_reset_where_it_stands(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            device.feed(b"G1 X1\nG1 X2\n")
            device.feed(b"!")
            driver = await opened(endpoint)
            assert (driver.first_report.state, driver.first_report.substate) == ("Hold", 1)
            assert device.realtime_seen.count(RealtimeCommand.RESET) == 1
            assert driver.position_trusted  # no homing here, and it stood still
            await driver.close()

    in_virtual_time(main())


def test_an_open_door_is_reported(controller, in_virtual_time):
    device = controller(GRBL)
    device.state, device.sub = "Door", 1
    device.restart = lambda: device.write(b"\r\nGrbl 1.1h ['$' for help]\r\n")
    assert refusal(in_virtual_time, device).what == "the safety door is open"


def test_a_controller_that_stays_busy_or_falls_silent_is_not_opened(controller, in_virtual_time):
    device = controller(GRBLHAL)
    device.state = "Sleep"
    device.restart = lambda: device.write(b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n")
    busy = refusal(in_virtual_time, device)
    assert busy.what == "the motion controller stays in state Sleep"
    assert "at its panel" in busy.hint
    device = controller(GRBL, block_s=1e6)
    reported = device.report

    def report_once():
        device.mute = len(device.asked_at_s) > 1
        return reported()

    device.report = report_once

    async def main():
        async with device.on_tcp() as endpoint:
            device.feed(b"G1 X1\n")
            await opened(endpoint, 3.0)

    with pytest.raises(MachineError, match="the motion controller stopped answering") as silent:
        in_virtual_time(main())
    assert "cable and power" in silent.value.hint


def test_an_alarm_does_not_prevent_opening(controller, in_virtual_time, dialect):
    device = controller(dialect)
    device.state = "Alarm"

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert driver.status.state == "Alarm"
            assert not driver.position_trusted
            await driver.home()
            assert driver.position_trusted
            driver.submit([b"G1 X1"])
            await asyncio.sleep(0.5)
            assert driver.lines_executed == 1
            await driver.close()

    in_virtual_time(main())


def test_a_homing_machine_is_trusted_only_after_homing_or_on_the_callers_word(
    controller, in_virtual_time, dialect
):
    async def main() -> None:
        async with controller(dialect, settings={22: "1"}).on_tcp() as endpoint:
            driver = await opened(endpoint)
            assert not driver.position_trusted
            driver.trust_position()
            assert driver.position_trusted
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize(
    ("parser_state", "offsets", "total"),
    [
        ("[GC:G0 G54 G17]", ["[G54:1.000,2.000,3.000]"], (1, 2, 3)),
        ("[GC:G0 G59.1 G17]", ["[G59.1:5.000,6.000,7.000]", "[G54:1.000,1.000,1.000]"], (5, 6, 7)),
        ("[GC:G0 G56]", ["[G56:0.000,0.000,1.000]", "[G92:1.000,2.000,3.000]", "[TLO:0.500]"],
         (1, 2, 4.5)),
        ("[GC:G0 G54]", ["[G54:0.000,0.000,0.000]", "[TLO:0.100,0.200,0.300]"], (0.1, 0.2, 0.3)),
        ("[GC:G0 G54]", [], (0, 0, 0)),
        ("", ["[G54:1.000,2.000,3.000,4.000]", "[G92:1.000,1.000,1.000,1.000]", "[TLO:1.000]"],
         (2, 3, 5, 5)),
        ("[GC:G0 G54]", ["[G54:1.000,2.000,3.000]", "[PRB:0.000,0.000,0.000:0]", "[G92:x]"],
         (1, 2, 3)),
    ],
)
def test_the_work_offset_is_the_sum_of_what_acts(parser_state, offsets, total):
    assert parse_work_offset([parser_state], offsets) == pytest.approx(total)


def test_the_same_driver_runs_on_an_ordinary_loop_in_real_time(controller):
    device = controller(GRBLHAL, block_s=0.0005)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.02)
            finished = asyncio.Event()
            driver.listener.on_progress = lambda: driver.lines_executed == 100 and finished.set()
            driver.submit([b"N%d G1 X1" % n for n in range(100)])
            await asyncio.wait_for(finished.wait(), 10.0)
            await driver.close()

    asyncio.run(main())
    assert device.done == 100
