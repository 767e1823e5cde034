"""Streams over real links: every line once, in order, counted apart, and never past its error."""

from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.host import LocalProtocolError
from firmware_protocol.realtime import RealtimeCommand
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver


def program(count: int) -> list[bytes]:
    """Motion lines, with a line that makes no block now and then."""
    return [
        b"N%d M4 S%d" % (n, n % 100) if n % 11 == 0 else b"N%d G1 X%d.5 F600" % (n, n % 90)
        for n in range(count)
    ]


async def opened(endpoint: str, period_s: float = 0.1) -> MotionDriver:
    return await MotionDriver.open(endpoint, baud=115_200, status_period_s=period_s)


async def until(condition, deadline_s: float = 60.0) -> None:
    async with asyncio.timeout(deadline_s):
        while not condition():  # noqa: ASYNC110 (the tests poll a clock that jumps)
            await asyncio.sleep(0.01)


def gcode(lines: list[bytes]) -> list[bytes]:
    return [line for line in lines if not line.startswith(b"$")]


@pytest.mark.parametrize("wire", ["tcp", "pty", "serial"])
@pytest.mark.parametrize("rx_bytes", [128, 1024])
def test_every_line_arrives_once_and_counts_never_run_ahead(
    controller, in_virtual_time, dialect, rx_bytes, wire
):
    device = controller(dialect, rx_bytes=rx_bytes)
    lines = program(400)

    async def main() -> None:
        serving = device.on_tcp() if wire == "tcp" else device.on_pty(wire)
        async with serving as endpoint:
            driver = await opened(endpoint)
            steps = []

            def progressed() -> None:
                steps.append((driver.lines_sent, driver.lines_acknowledged, driver.lines_executed))
                assert driver.lines_sent >= driver.lines_acknowledged >= driver.lines_executed
                assert driver.lines_executed <= device.done

            driver.listener = MotionCallbacks(on_progress=progressed)
            driver.submit(lines[:100])
            driver.submit(lines[100:])
            await until(lambda: driver.lines_executed == 400)
            assert (driver.lines_sent, driver.lines_acknowledged, driver.lines_queued) == (400, 400,
                                                                                           0)
            assert steps == sorted(steps)
            assert len({executed for _, _, executed in steps}) > 20  # it was followed, not guessed
            await driver.close()

    in_virtual_time(main())
    assert gcode(device.received) == lines
    assert device.device.overruns == 0
    assert device.done == 400


def test_executed_follows_line_numbers_closely_and_blocks_with_care(controller, in_virtual_time):
    """By Ln: the line in motion a report ago (5 blocks) is the first not executed; Bf: one more.

    A report must be as old as a segment buffer is long, which this controller does not have.
    """
    lags = {}

    async def main(name, device) -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            seen = []
            driver.listener.on_status = lambda report: seen.append(
                device.done - driver.lines_executed)
            driver.submit([b"N%d G1 X1 F600" % n for n in range(100)])
            await until(lambda: driver.lines_executed == 100)
            lags[name] = set(seen[2:-2])
            await driver.close()

    in_virtual_time(main("Ln", controller(GRBLHAL)))
    in_virtual_time(main("Bf", controller(GRBLHAL, settings={10: "3"})))
    in_virtual_time(main("Grbl", controller(GRBL)))
    # A report may fall on the end of a block, before or after it.
    assert lags["Ln"] <= {4, 5}
    assert lags["Bf"] <= {5, 6}
    assert lags["Grbl"] <= {5, 6}


@pytest.mark.parametrize("mask", [3, 4, 511])
def test_executed_is_known_whatever_the_reports_carry(controller, in_virtual_time, mask):
    device = controller(GRBLHAL, settings={10: str(mask)})

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(program(60))
            await until(lambda: driver.lines_executed == 60)
            await driver.close()

    in_virtual_time(main())
    assert device.done == 60


def test_lines_without_motion_wait_for_the_motion_before_them(controller, in_virtual_time):
    device = controller(GRBL, block_s=1.0)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit([b"M4 S5", b"G1 X1 F60", b"M5", b"G1 X2", b"G1 X3", b"G1 X4"])
            await until(lambda: driver.lines_acknowledged == 6)
            await asyncio.sleep(0.5)
            # X1 is moving; M4 is only surely past once it is over
            assert driver.lines_executed == 0
            await until(lambda: driver.lines_executed == 6)
            await driver.close()

    in_virtual_time(main())


def test_a_second_stream_counts_from_zero_after_a_reset(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(program(300))
            await until(lambda: driver.lines_executed > 20)
            await driver.hold()
            done = driver.lines_executed
            dropped = driver.lines_queued
            await driver.reset()
            assert driver.lines_executed == done  # what was executed stays known after the reset
            assert dropped > 0
            assert driver.lines_queued == 0
            taken = len(gcode(device.received))
            await asyncio.sleep(1.0)
            assert len(gcode(device.received)) == taken  # nothing of the old stream follows
            driver.submit(program(30))
            await until(lambda: driver.lines_executed == 30)
            assert gcode(device.received)[taken:] == program(30)
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("wire", ["tcp", "serial"])
def test_the_first_error_holds_the_machine_and_is_reported_once(
    controller, in_virtual_time, dialect, wire
):
    device = controller(dialect, block_s=0.5)
    lines = program(200)
    lines[7] = b"N7 G99"

    async def main() -> None:
        errors = []
        async with device.on_tcp() if wire == "tcp" else device.on_pty(wire) as endpoint:
            driver = await opened(endpoint)
            driver.listener.on_error = lambda tag, code: errors.append((tag, code))
            driver.submit(lines)
            await until(lambda: errors)
            await until(lambda: device.state == "Hold")
            sent = driver.lines_sent
            await asyncio.sleep(20.0)
            assert errors == [(7, 20)]
            assert device.realtime_seen.count(RealtimeCommand.HOLD) == 1
            assert driver.lines_sent == sent < 200
            assert driver.lines_acknowledged == 7
            assert driver.lines_executed <= 7
            await driver.reset()
            driver.submit(program(5))
            await until(lambda: driver.lines_executed == 5)
            await driver.close()

    in_virtual_time(main())


def test_lines_that_could_never_be_sent_are_our_bug_and_none_is_queued(
    controller, in_virtual_time
):
    device = controller(GRBL)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            for bad in (b"G1 X1\n", b"(hold!)", b"X" * 80, "µ".encode()):
                with pytest.raises(LocalProtocolError):
                    driver.submit([b"G1 X1", bad])
            assert (driver.lines_sent, driver.lines_queued) == (0, 0)
            await driver.close()

    in_virtual_time(main())


def test_discarded_lines_are_never_sent(controller, in_virtual_time):
    device = controller(GRBL, block_s=0.1)

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit(program(100))
            sent = driver.lines_sent
            assert driver.discard_queue() == 100 - sent
            await until(lambda: driver.lines_executed == sent)
            assert gcode(device.received) == program(100)[:sent]
            await driver.close()

    in_virtual_time(main())


def test_lines_go_out_several_at_once_where_the_wire_allows_and_the_planner_stays_fed(
    controller, in_virtual_time
):
    device = controller(GRBLHAL, blocks=10)
    arrivals, least_waiting = [], []

    def feed(data: bytes, usual=device.feed) -> None:
        if b"X" in data:
            arrivals.append(data.count(b"\n"))
            least_waiting.append(device.device.buffered_lines)
        usual(data)

    device.feed = feed

    async def main() -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            driver.submit([b"N%d G1 X1.234 Y5.678 F600" % n for n in range(400)])
            await until(lambda: driver.lines_executed == 400)
            await driver.close()

    in_virtual_time(main())
    assert len(arrivals) < 400 / 5
    assert min(least_waiting[1:-1]) > 15  # of 38 that the buffer holds


def test_the_same_stream_gives_the_same_history(controller, in_virtual_time):
    """At every instant the same counts, however the kernel cut the bytes within it."""
    histories = []

    async def main(device) -> None:
        async with device.on_tcp() as endpoint:
            driver = await opened(endpoint)
            loop = asyncio.get_running_loop()
            history: dict[float, tuple[int, int]] = {}

            def note() -> None:
                history[loop.time()] = driver.lines_acknowledged, driver.lines_executed

            driver.listener.on_progress = note
            driver.submit(program(300))
            await until(lambda: driver.lines_executed == 300)
            histories.append(history)
            await driver.close()

    for _ in range(3):
        in_virtual_time(main(controller(GRBLHAL)))
    assert len(histories[0]) > 50
    same = histories[0] == histories[1] == histories[2]
    assert same  # not compared here: the difference of long histories takes minutes to print


@pytest.mark.parametrize("wire", ["tcp", "pty", "serial"])
def test_lines_submitted_as_a_question_is_put_are_there_when_it_is_answered(
    controller, in_virtual_time, dialect, wire
):
    """They go ahead of the question, and their answers come in the same turn as the report."""
    device = controller(dialect, block_s=0.3)  # longer than a period: it never stands in between
    lines = program(40)

    async def main() -> None:
        serving = device.on_tcp() if wire == "tcp" else device.on_pty(wire)
        async with serving as endpoint:
            driver = await opened(endpoint)
            waiting, reported = list(lines), []

            def question() -> None:
                if waiting:
                    driver.submit([waiting.pop(0)])
                reported.append(("asked", driver.lines_sent))

            driver.listener = MotionCallbacks(
                on_query=question,
                on_status=lambda report: reported.append(("told", driver.lines_sent)),
            )
            await until(lambda: driver.lines_executed == len(lines))
            asked = reported[reported.index(("asked", 1)) :]
            answered = [(a, b) for a, b in pairwise(asked) if b[0] == "told"]
            assert len(answered) >= len(lines)
            assert all(a == ("asked", sent) for a, (_, sent) in answered)
            await driver.close()

    in_virtual_time(main())
    assert gcode(device.received) == lines
