"""Links that vanish, return, stall, echo garbage, or reboot the board: what the driver says.

Against the simulated controller over its real wires; faults alter the bytes at its edge.
"""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager

import pytest

from firmware_protocol.realtime import RealtimeCommand
from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver
from simulators.faults.filters import AlterBytes, DelayBytes, FreezeStatusReports, GarbledEcho
from simulators.faults.link_tap import LinkTap
from simulators.motion.config import MotionConfig
from simulators.motion.server import open_pty, serve_tcp
from simulators.motion.simulator import MotionSimulator

SETTINGS = {30: 1000, 32: 1, 110: 6000, 111: 6000, 112: 6000, 120: 500, 121: 500, 122: 500,
            130: 300, 131: 300, 132: 200}
LINES = [b"N0 G21 G90 G94 F1200", b"N1 M4 S0",
         *(b"N%d G1 X%d Y%d S500" % (n, 10 + n % 7, 10 + n % 5) for n in range(2, 200))]

both_dialects = pytest.mark.parametrize("name", ["grbl", "grblhal"])
every_wire = pytest.mark.parametrize("wire", ["tcp", "pty", "serial"])


@asynccontextmanager
async def streaming(name: str, wire: str):
    """Driver and controller two seconds into a program, and what the driver has told since."""
    sim = MotionSimulator(MotionConfig(
        dialect=name, settings=SETTINGS | {10: 3 if name == "grbl" else 511}))
    edge = LinkTap()
    if wire == "tcp":
        server = await serve_tcp(sim, edge=edge)
        endpoint = f"tcp://127.0.0.1:{server.port}"
    else:
        server = open_pty(sim, edge)
        endpoint = f"{wire}://{server.path}"
    driver = await opened(endpoint)
    reported = []
    driver.listener = MotionCallbacks(
        on_error=lambda tag, code: reported.append(("error", tag, code)),
        on_alarm=lambda code: reported.append(("alarm", code)),
        on_restart=lambda: reported.append(("restart",)),
        on_lost=lambda reason: reported.append(("lost", reason)),
    )
    driver.submit(LINES)
    try:
        await asyncio.sleep(2.0)
        assert driver.lines_executed > 2
        assert reported == []
        yield sim, edge, driver, reported, endpoint
    finally:
        await driver.close()
        server.close()
        sim.close()
        await asyncio.sleep(0)


async def opened(endpoint: str) -> MotionDriver:
    return await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)


async def reported_within(reported: list, seconds: float) -> float:
    """Time until something was told."""
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    while not reported:
        assert loop.time() - begun_s < seconds, "no error was reported"
        await asyncio.sleep(0.01)
    return loop.time() - begun_s


def truly_done(sim: MotionSimulator) -> int:
    """Lines up to the last move executed to its end."""
    done = [n for n in sim.executed_line_numbers if n]
    return done[-1] + 1 if done else 2


@both_dialects
@every_wire
def test_a_link_that_vanishes_and_returns_is_a_loss_until_it_is_opened_again(
    in_virtual_time, name, wire
):
    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, endpoint):
            edge.set_open(False)
            took_s = await reported_within(reported, 4.0)
            ((kind, reason),) = reported
            assert kind == "lost"
            assert took_s < 0.1 if wire == "tcp" else took_s < 3.3
            assert ("was lost: " if wire == "tcp" else "no answer to '?'") in reason
            assert driver.lines_executed <= truly_done(sim)
            edge.set_open(True)
            await asyncio.sleep(20.0)  # the controller runs dry
            sent = driver.lines_sent
            with pytest.raises(MachineError, match=r"was lost|no answer"):
                await driver.send_command("$G")
            # The link does not come back by itself.
            assert (len(reported), driver.lines_sent) == (1, sent)
            await driver.close()
            heir = await opened(endpoint)
            assert heir.status.state == "Idle"
            assert heir.position_mm == pytest.approx(sim.position_mm, abs=0.001)
            heir.submit([b"G1 X1 Y1 F6000"])
            await asyncio.sleep(5.0)
            assert heir.lines_executed == 1
            await heir.close()

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_link_that_stalls_is_silence_and_no_line_is_claimed(in_virtual_time, name, wire):
    """Nothing is read any more at the far end; the controller goes on with what it has."""

    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            edge.set_reading_enabled(False)
            await reported_within(reported, 4.0)
            ((kind, reason),) = reported
            assert kind == "lost"
            assert "no answer to '?'" in reason
            assert driver.lines_executed <= truly_done(sim)

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_short_stall_is_none(in_virtual_time, name, wire):
    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            edge.set_reading_enabled(False)
            await asyncio.sleep(1.5)
            edge.set_reading_enabled(True)
            while driver.lines_executed < len(LINES):  # noqa: ASYNC110
                await asyncio.sleep(0.1)
            assert reported == []
            assert sim.executed_line_numbers == list(range(2, len(LINES)))

    in_virtual_time(main())


@both_dialects
@every_wire
def test_answers_that_come_late_are_waited_for(in_virtual_time, name, wire):
    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            edge.add_filter("to_host", DelayBytes(0.4))
            while driver.lines_executed < len(LINES):
                assert driver.lines_executed <= truly_done(sim) + (truly_done(sim) == len(LINES))
                await asyncio.sleep(0.1)
            assert reported == []
            assert sim.rx_overrun_bytes == 0

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_garbled_echo_of_what_is_sent_is_no_answer_and_is_counted(in_virtual_time, name, wire):
    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            edge.add_filter("to_device", GarbledEcho(edge.send_to_host))
            await asyncio.sleep(20.0)
            assert driver.damaged_message_count > 0
            assert driver.lines_executed <= driver.lines_acknowledged
            assert driver.lines_executed <= truly_done(sim)
            assert all(kind in ("lost", "error") for kind, *_ in reported)

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_board_that_reboots_in_mid_program_stops_everything(in_virtual_time, name, wire):
    """Power gone and back, or DTR toggled by another program that opens the port."""

    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            claimed = truly_done(sim)
            edge.send_to_host(sim.lose_power())
            await reported_within(reported, 1.0)
            assert reported == [("restart",)]
            assert not driver.position_trusted
            assert driver.lines_executed <= claimed
            moved = len(sim.executed_line_numbers)
            driver.submit([b"G1 X50 Y50 F600"])
            await asyncio.sleep(10.0)
            # nothing moves until it is asked for anew
            assert len(sim.executed_line_numbers) == moved
            await driver.reset()
            assert not driver.position_trusted

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_reboot_whose_banner_is_lost_does_not_credit_the_lines_that_died(
    in_virtual_time, name, wire
):
    async def main() -> None:
        async with streaming(name, wire) as (sim, _, driver, reported, _):
            claimed = truly_done(sim)
            sim.lose_power()  # and its messages reach no host
            await reported_within(reported, 10.0)
            assert reported[0][0] in ("lost", "alarm", "error")
            assert driver.lines_executed <= claimed

    in_virtual_time(main())


@both_dialects
@every_wire
def test_frozen_reports_make_nothing_done(in_virtual_time, name, wire):
    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, _, _):
            edge.add_filter("to_host", FreezeStatusReports("Run"))
            await asyncio.sleep(0.5)
            seen = driver.lines_executed
            await asyncio.sleep(5.0)
            assert driver.lines_executed <= max(seen, truly_done(sim))

    in_virtual_time(main())


@both_dialects
@every_wire
@pytest.mark.parametrize("direction", ["to_device", "to_host"])
@pytest.mark.parametrize("change", ["lost", "flipped", "doubled"])
def test_disturbed_bytes_end_in_words_or_in_the_whole_program(
    in_virtual_time, name, wire, direction, change
):
    """Whatever it comes to, executed never runs ahead of the axes by a doubled answer's line."""
    changed = {"lost": lambda byte: b"", "flipped": lambda byte: bytes((byte ^ 4,)),
               "doubled": lambda byte: bytes((byte, byte))}[change]

    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, reported, _):
            edge.add_filter(
                direction, AlterBytes(changed, count=30, every=61, on_finished=lambda: None))
            loop = asyncio.get_running_loop()
            begun_s = loop.time()
            while driver.lines_executed < len(LINES) and not reported:
                assert loop.time() - begun_s < 300.0
                assert driver.lines_executed <= driver.lines_acknowledged
                await asyncio.sleep(0.05)
            assert all(kind in ("lost", "error", "alarm", "restart") for kind, *_ in reported)
            if direction == "to_host" and change == "lost":
                assert driver.lines_executed <= truly_done(sim) + (truly_done(sim) == len(LINES))

    in_virtual_time(main())


@both_dialects
@every_wire
def test_a_hold_reaches_a_controller_whose_answers_are_lost(in_virtual_time, name, wire):
    """Beam and motion down first; that no reply comes is reported after."""

    async def main() -> None:
        async with streaming(name, wire) as (sim, edge, driver, _, _):
            edge.add_filter("to_host", lambda data, deliver: None)
            with pytest.raises(MachineError, match="no hold showed within"):
                await driver.hold()
            at = sim.position_mm
            await asyncio.sleep(1.0)
            assert sim.position_mm == at
            driver.send_realtime(RealtimeCommand.RESET)
            await asyncio.sleep(1.0)
            assert sim.position_mm == at

    in_virtual_time(main())
