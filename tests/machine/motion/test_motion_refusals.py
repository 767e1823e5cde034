"""What never goes into a stream, whoever asks: it is refused before a byte of it is sent."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_protocol.device import GrblDevice
from firmware_protocol.host import LocalProtocolError
from lmctl.machine.motion.driver import MotionDriver

STORING = [b"$110=500", b"$N0=G54", b"$I=me", b"$RST=*", b"$H", b"$", b" $X", b"G10 L2 P1 X0",
           b"N7 G10 L20 P1 X0", b"G28.1", b"G30.1", b"g10l20p1x0", b"G 28.1", b"G028.1", b"G28.10",
           b"G90G10L2P1X0"]
ACTING = [b"G1 X1!", b"?", b"(what?)", b"G1 ~X1", b"\x18", b"G1 X1\x85", "G1 X1 (µ)".encode(),
          b"G1\nX1", b"G1 X1\r", b"G1 X1\n", b"\x00", b"\x7f"]
FINE = [b"G28 X0", b"G30", b"G1 X10 G90", b"N10 G1 X28.1 Y30.1", b"G1 X1 P10", b"G4 P10.5"]


@pytest.mark.parametrize("line", [*STORING, *ACTING])
def test_it_is_refused_in_words_and_nothing_of_the_batch_is_sent(
    controller, in_virtual_time, dialect, line
):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_pty() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            before, acted = len(device.received), bytes(device.realtime_seen).replace(b"?", b"")
            with pytest.raises(LocalProtocolError, match=r"sent alone|act or break") as refused:
                driver.submit([b"G1 X1 F60", line, b"G1 X2"])
            assert repr(line)[2:-1] in str(refused.value)
            assert (driver.lines_sent, driver.lines_queued) == (0, 0)
            await driver.send_command("$G")
            assert device.received[before:] == [b"$G"]
            assert bytes(device.realtime_seen).replace(b"?", b"") == acted
            await driver.close()

    in_virtual_time(main())


def test_lines_that_only_look_like_those_pass(controller, in_virtual_time, dialect):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_pty() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            driver.submit(FINE)
            assert driver.lines_sent == len(FINE)
            await driver.close()

    in_virtual_time(main())


@settings(max_examples=60, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(line=st.binary(max_size=120))
def test_whatever_is_submitted_nothing_acts_and_no_line_becomes_two(
    controller, in_virtual_time, dialect, line
):
    """Either it is refused, or the wire carries that line, its end, and not a byte that acts."""

    async def main() -> None:
        async with controller(dialect).on_pty() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            written = []
            driver._connection.write = written.append
            try:
                driver.submit([line])
            except LocalProtocolError:
                assert written == []
            else:
                assert b"".join(written) == line + b"\n"
                device = GrblDevice(dialect, 1024)
                assert device.receive_data(b"".join(written)) == b""
                assert device.pop_line() == line
                assert device.buffered_lines == 0
                assert not line.strip().startswith(b"$")
            await driver.close()

    in_virtual_time(main())


@pytest.mark.parametrize("line", ["$H\n$X", "G1 X1!", "µ", "G1\rX1"])
def test_a_command_cannot_smuggle_either(controller, in_virtual_time, dialect, line):
    device = controller(dialect)

    async def main() -> None:
        async with device.on_pty() as endpoint:
            driver = await MotionDriver.open(endpoint, baud=115_200, status_period_s=0.1)
            before = len(device.received)
            with pytest.raises(LocalProtocolError, match="act or break"):
                await driver.send_command(line)
            await driver.send_command("$G")
            assert device.received[before:] == [b"$G"]
            await driver.close()

    in_virtual_time(main())
