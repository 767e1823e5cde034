"""Answers that came twice or never are noticed while the stream runs; and nothing else is."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import parse_status
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver
from simulators.faults.filters import RepeatOkReplies
from simulators.faults.link_tap import LinkTap
from simulators.motion.config import MotionConfig
from simulators.motion.server import open_pty, serve_tcp
from simulators.motion.simulator import MotionSimulator

TRANSCRIPTS = Path(__file__).parents[2] / "firmware_protocol" / "transcripts"
STATUS_S = 0.1
SETTINGS = {30: 1000, 32: 1, 110: 6000, 111: 6000, 112: 6000, 120: 500, 121: 500, 122: 500,
            130: 300, 131: 300, 132: 200}
WIRES = [(wire, rx_bytes) for wire in ("tcp", "pty", "serial") for rx_bytes in (128, 1024)]
TURNS = [RealtimeCommand.FEED_PLUS_10, RealtimeCommand.FEED_MINUS_10, RealtimeCommand.FEED_100,
         RealtimeCommand.RAPID_50,
         RealtimeCommand.SPINDLE_PLUS_10, RealtimeCommand.SPINDLE_MINUS_1]

every_wire = pytest.mark.parametrize(("wire", "rx_bytes"), WIRES)


class Machine:
    """A simulated controller behind a wire, a driver, and what the driver tells."""

    def __init__(self, name: str, wire: str, rx_bytes: int, mask: int | None = None) -> None:
        mask = mask or (3 if name == "grbl" else 511)
        self.sim = MotionSimulator(
            MotionConfig(dialect=name, rx_bytes=rx_bytes, settings=SETTINGS | {10: mask})
        )
        self.edge = LinkTap()
        self.reported: list[str] = []
        self._wire = wire

    async def __aenter__(self) -> Machine:
        if self._wire == "tcp":
            self._server = await serve_tcp(self.sim, edge=self.edge)
            endpoint = f"tcp://127.0.0.1:{self._server.port}"
        else:
            self._server = open_pty(self.sim, self.edge)
            endpoint = f"{self._wire}://{self._server.path}"
        self.driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=STATUS_S)
        self.driver.listener = MotionCallbacks(on_lost=self.reported.append)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.driver.close()
        self._server.close()
        self.sim.close()
        await asyncio.sleep(0)

    def answers(self, times: int, count: int) -> None:
        """The next `count` answers come so many times."""
        one = RepeatOkReplies(times, count, lambda: self.edge.remove_filter("to_host", one))
        self.edge.add_filter("to_host", one)

    async def ended(self, within_s: float) -> None:
        async with asyncio.timeout(within_s):
            while not self.reported and self.driver.lines_executed < self.driver.lines_sent:  # noqa: ASYNC110
                await asyncio.sleep(0.005)


def wiggle(steps_mm: list[float], feed_mm_min: int = 1200) -> list[bytes]:
    """A way on along a circle by steps of these lengths."""
    lines = [b"N0 G21 G90 G94", b"N1 M4 S0", b"N2 G1 X60 Y50 F6000 S0"]
    angles = np.cumsum(steps_mm) / 10
    for x, y in zip(50 + 10 * np.cos(angles), 50 + 10 * np.sin(angles), strict=True):
        lines.append(b"N%d G1 X%.3f Y%.3f F%d S500" % (len(lines), x, y, feed_mm_min))
    return lines


@pytest.mark.parametrize("name", ["grbl", "grblhal"])
@pytest.mark.parametrize(("wire", "rx_bytes", "count"), [
    *[(*one, 1) for one in WIRES], *[("tcp", 1024, count) for count in (2, 3, 10)],
])
def test_an_answer_that_comes_twice_is_reported_within_a_status_period(
    in_virtual_time, name, wire, rx_bytes, count
):
    async def main() -> None:
        async with Machine(name, wire, rx_bytes) as machine:
            machine.driver.submit(wiggle([0.3] * 2000))
            await asyncio.sleep(5.0)
            loop = asyncio.get_running_loop()
            machine.answers(2, count)
            came_s = loop.time()
            await machine.ended(5.0)
            assert loop.time() - came_s < STATUS_S + 0.05 * count
            assert "answer came" in machine.reported[0]
            if count == 1:  # more, and more is sent than there is room for
                assert machine.sim.rx_overrun_bytes == 0
            await asyncio.sleep(0.3)
            assert len(machine.reported) == 1
            at = machine.sim.position_mm
            await asyncio.sleep(1.0)
            assert machine.sim.position_mm == at  # held

    in_virtual_time(main())


@every_wire
def test_an_answer_that_is_lost_is_reported_within_a_status_period_where_lines_are_numbered(
    in_virtual_time, wire, rx_bytes
):
    async def main() -> None:
        async with Machine("grblhal", wire, rx_bytes) as machine:
            machine.driver.submit(wiggle([0.3] * 2000))
            await asyncio.sleep(5.0)
            loop = asyncio.get_running_loop()
            machine.answers(0, 1)
            came_s = loop.time()
            await machine.ended(5.0)
            assert loop.time() - came_s < 2 * STATUS_S
            assert "an answer is missing" in machine.reported[0]

    in_virtual_time(main())


def test_without_a_count_of_blocks_the_line_at_the_head_shows_lost_answers(in_virtual_time):
    """$10 without Bf: as soon as a line is executed that has not been answered."""
    async def main() -> None:
        async with Machine("grblhal", "tcp", 1024, mask=511 - 2) as machine:
            machine.driver.submit(wiggle([2.0] * 10))
            await asyncio.sleep(0.2)
            assert machine.driver.status.planner_blocks_free is None
            machine.answers(0, 5)
            machine.driver.submit(wiggle([1.0] * 20)[3:])
            await machine.ended(10.0)
            assert "an answer is missing" in machine.reported[0]

    in_virtual_time(main())


def test_no_report_of_the_real_firmwares_shows_more_in_their_buffers_than_was_sent():
    """Their own words (transcripts), against the sizes that the audit takes for granted."""
    for dialect, name in ((GRBL, "grbl-1.1h"), (GRBLHAL, "grblhal")):
        empty = dialect.rx_bytes - dialect.rx_report_margin
        shown, sent = [], 0
        for line in (TRANSCRIPTS / f"{name}.jsonl").read_text().splitlines():
            scenario = json.loads(line)
            # Each begins with an empty line; a controller that waits for a tool keeps them all.
            sent += 1 + sum(len(text) for text in scenario["sent"] if text.endswith("\n"))
            for text in scenario["received"]:
                report = parse_status(text)
                if report is not None and report.rx_bytes_free is not None:
                    assert 0 <= empty - report.rx_bytes_free <= sent
                    shown.append(report.rx_bytes_free)
        assert max(shown) == empty


@settings(max_examples=60, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["grbl", "grblhal"]),
    wire=st.sampled_from(WIRES),
    steps_mm=st.lists(st.sampled_from([0.002, 0.02, 0.1, 0.5, 3.0]), min_size=20, max_size=300),
    acts=st.lists(st.tuples(st.floats(0.0, 0.4), st.sampled_from(["hold", "ask", "few", *TURNS])),
                  max_size=12),
    portion=st.integers(1, 60),
)
def test_a_sound_link_is_never_doubted_for_long_and_never_given_up(
    in_virtual_time, name, wire, steps_mm, acts, portion
):
    lines = wiggle(steps_mm)

    async def main() -> None:
        async with Machine(name, *wire) as machine:
            driver, rest = machine.driver, list(lines)
            driver.listener.on_query = lambda: submit()

            def submit() -> None:
                driver.submit(rest[:portion])
                del rest[:portion]

            submit()
            for wait_s, act in acts:
                await asyncio.sleep(wait_s)
                if act == "hold":
                    await driver.hold()
                    await driver.resume()
                elif act == "ask":
                    driver.send_realtime(RealtimeCommand.STATUS)
                elif act == "few":
                    submit()
                else:
                    driver.send_realtime(act)
            async with asyncio.timeout(600.0):
                while rest or driver.lines_executed < len(lines):
                    assert machine.reported == []
                    await asyncio.sleep(0.05)
            assert machine.reported == []
            assert machine.sim.rx_overrun_bytes == 0

    in_virtual_time(main())
