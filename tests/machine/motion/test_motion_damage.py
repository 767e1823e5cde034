"""The motion driver hears a damaged controller over a real pty: it ends, and claims nothing.

What the driver hears is counted by an oracle of this test, byte for byte. The controller itself is
scripted, and knows which lines it has really done.
"""

from __future__ import annotations

import asyncio
import itertools
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionCallbacks, MotionDriver

LINES = [b"N%d G1 X%d.5 F600" % (n, n % 90) for n in range(60)]
ANSWER = re.compile(rb"(?:ok|error:\d+)\r?")
# A controller that stands still and owes answers is given up after five seconds.
ENDS_WITHIN_S = 60.0


class Line:
    """What happens to each chunk on its way, by its place; the rest passes."""

    def __init__(self, write, acts: dict[int, tuple]) -> None:
        self.received = b""
        self._write = write
        self._acts = acts
        self._place = 0

    def __call__(self, data: bytes) -> None:
        kind, at, bit = self._acts.get(self._place, ("pass", 0, 0))
        self._place += 1
        at %= len(data)
        if kind == "flip":
            damaged = bytearray(data)
            damaged[at] ^= 1 << bit
            data = bytes(damaged)
        elif kind == "cut":
            data = data[:at]
        elif kind == "drop":
            data = b""
        elif kind == "repeat":
            data += data
        elif kind == "noise":
            data = bytes((at * 37 + bit + n * n) % 256 for n in range(20)) + data
        # The rest of "chop": in two writes.
        for part in (data[:at], data[at:]):
            if part:
                self.received += part
                self._write(part)

    @property
    def answers(self) -> int:
        return sum(ANSWER.fullmatch(line) is not None for line in self.received.split(b"\n")[:-1])


def streamed(in_virtual_time, device, acts: dict[int, tuple]) -> dict:
    """Stream LINES with damage from the first line on; how it ended."""
    complaints, reported, ahead = [], [], []

    async def main() -> dict:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: complaints.append(context))
        async with device.on_pty() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            line = device.write = Line(device.write, acts)

            def progressed() -> None:
                assert driver.lines_executed <= driver.lines_acknowledged <= driver.lines_sent
                assert driver.lines_acknowledged <= line.answers
                ahead.append(driver.lines_executed - device.done)

            driver.listener = MotionCallbacks(
                on_progress=progressed,
                on_error=lambda tag, code: reported.append("error"),
                on_alarm=lambda code: reported.append("alarm"),
                on_restart=lambda: reported.append("restart"),
                on_lost=lambda reason: reported.append(reason),
            )
            driver.submit(LINES)
            begun_s = loop.time()
            while driver.lines_executed < len(LINES) and not reported:
                assert loop.time() - begun_s < ENDS_WITHIN_S, "nothing ended it"
                await asyncio.sleep(0.05)
            progressed()
            await driver.close()
            return {"told": reported, "executed": driver.lines_executed, "ahead": max(ahead),
                    "damaged": driver.damaged_message_count}

    ended = in_virtual_time(main())
    assert complaints == []
    assert device.device.overruns == 0 or any(act[0] != "drop" for act in acts.values())
    return ended


acts = st.dictionaries(
    st.integers(0, 90),
    st.tuples(st.sampled_from(["flip", "cut", "drop", "repeat", "noise", "chop"]),
              st.integers(0, 100), st.integers(0, 7)),
    max_size=6,
)
same_fixtures = settings(max_examples=25, deadline=None,
                         suppress_health_check=[HealthCheck.function_scoped_fixture])


@same_fixtures
@given(acts=acts)
def test_any_damage_ends_and_credits_only_what_was_answered(
    controller, in_virtual_time, dialect, acts
):
    ended = streamed(in_virtual_time, controller(dialect), acts)
    if not ended["told"]:
        assert ended["executed"] == len(LINES)


@same_fixtures
@given(places=st.sets(st.integers(0, 90), min_size=1, max_size=6), data=st.data())
def test_bytes_that_are_lost_never_make_a_line_done_that_is_not(
    controller, in_virtual_time, dialect, places, data
):
    acts = {
        place: (data.draw(st.sampled_from(["cut", "drop", "chop"])), data.draw(st.integers(0, 99)),
                0)
        for place in places
    }
    ended = streamed(in_virtual_time, controller(dialect), acts)
    assert ended["ahead"] <= 0


def test_a_lost_answer_is_reported_and_what_was_done_is_known(controller, in_virtual_time, dialect):
    ended = streamed(in_virtual_time, controller(dialect), {10: ("drop", 0, 0)})
    assert len(ended["told"]) == 1
    assert "unanswered" in ended["told"][0]


@pytest.mark.parametrize("kind", ["flip", "cut", "noise"])
def test_damaged_messages_are_counted(controller, in_virtual_time, dialect, kind):
    ended = streamed(in_virtual_time, controller(dialect),
                     dict.fromkeys((20, 40), (kind, 1, 2)))
    assert ended["damaged"] >= 1


@same_fixtures
@given(data=st.data())
def test_a_damaged_introduction_is_refused_in_words_or_met_all_the_same(
    controller, in_virtual_time, dialect, data
):
    """Settings and identity decide what may run, so they are believed only whole."""
    acts = {
        place: (data.draw(st.sampled_from(["cut", "drop", "repeat", "noise", "chop"])),
                data.draw(st.integers(0, 99)), data.draw(st.integers(0, 7)))
        for place in data.draw(st.sets(st.integers(0, 30), min_size=1, max_size=4))
    }
    device = controller(dialect)

    async def main() -> None:
        async with device.on_pty() as endpoint:
            device.write = Line(device.write, acts)
            try:
                driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            except MachineError:
                return
            assert driver.identity.rx_bytes == device.device.rx_bytes
            assert driver.identity.planner_blocks == device.blocks
            if driver.settings.get(32) != "1" or not driver.settings.get(10, "").isdecimal():
                with pytest.raises(MachineError):
                    driver.submit([b"N0 G21 G90 G94"])
            await driver.close()

    in_virtual_time(main())


def test_the_settings_are_not_believed_with_a_hole(controller, in_virtual_time, dialect):
    """The line that says laser mode is off comes damaged: no program may run."""
    for at, bit in itertools.product(range(5), range(8)):
        device = controller(dialect, settings={32: "0"})

        async def main(device=device, at=at, bit=bit) -> None:
            async with device.on_pty() as endpoint:
                whole = device.write

                def write(data: bytes) -> None:
                    if data.startswith(b"$32="):
                        damaged = bytearray(data)
                        damaged[at] ^= 1 << bit
                        data = bytes(damaged)
                    whole(data)

                device.write = write
                if (at, bit) == (4, 0):  # `0` has become `1`: only the next reading can tell
                    return
                driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
                with pytest.raises(MachineError, match="laser mode is off"):
                    driver.submit([b"N0 G21 G90 G94"])
                await driver.close()

        in_virtual_time(main())


def test_a_doubled_answer_holds_the_machine_and_the_counts_are_disowned(
    controller, in_virtual_time, dialect
):
    """It credits a line too early. Three reports of the controller's buffer prove that where they
    come in time; else, once all are answered, one answer too many does."""
    ended = streamed(in_virtual_time, controller(dialect), {3: ("repeat", 0, 0)})
    (told,) = ended["told"]
    assert told.startswith(("an answer came twice: ", "a reply came to no command: "))
    assert "what was executed cannot be known" in told
