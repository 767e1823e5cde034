"""The device end: real-time bytes anywhere, a receive buffer that overruns, lines in order."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.host import ControllerRestarted, GrblHost, LineRejected
from firmware_protocol.messages import ErrorReply, OkReply, WelcomeBanner
from firmware_protocol.realtime import RealtimeCommand

BOTH = pytest.mark.parametrize("dialect", [GRBL, GRBLHAL], ids=lambda dialect: dialect.name)


def taken(device: GrblDevice) -> list[bytes]:
    lines = []
    while (line := device.pop_line()) is not None:
        lines.append(line)
    return lines


@BOTH
def test_realtime_bytes_are_picked_out_anywhere_even_inside_comments(dialect):
    device = GrblDevice(dialect)
    assert device.receive_data(b"G1?X10 (wh!at)\nG1~X2\x850\n\x91?") == b"?!~\x85\x91?"
    assert taken(device) == [b"G1X10 (what)", b"G1X20"]


def test_what_is_realtime_and_what_is_thrown_away_differs():
    every = bytes(range(0x80, 0x100))
    grbl, hal = GrblDevice(GRBL), GrblDevice(GRBLHAL)
    assert grbl.receive_data(every + b"\n") == bytes((0x84, 0x85, *range(0x90, 0x98),
                                                      *range(0x99, 0x9F), 0xA0, 0xA1))
    assert taken(grbl) == [b""]
    assert set(hal.receive_data(every + b"\n")) == {b for b in GRBLHAL.realtime_bytes if b >= 0x80}
    assert taken(hal) == [bytes(range(0xC0, 0x100))]
    assert GrblDevice(GRBLHAL).receive_data(b"\x19") == b"\x19"
    assert GrblDevice(GRBL).receive_data(b"\x19") == b""


@BOTH
def test_line_ends(dialect):
    device = GrblDevice(dialect)
    device.receive_data(b"A\nB\rC\r\n\nD")
    assert taken(device) == [b"A", b"B", b"C", b"", b""]
    device.receive_data(b"\n")
    assert taken(device) == [b"D"]


@BOTH
@given(places=st.lists(st.integers(0, 60), max_size=10))
def test_any_cutting_gives_the_same_lines_and_bytes(dialect, places):
    stream = b"G1 X1\nG1?X2\n\n(long! comment)\nM5\r$H~\n"
    edges = [0, *sorted(min(place, len(stream)) for place in places), len(stream)]
    device = GrblDevice(dialect)
    picked = b"".join(
        device.receive_data(stream[a:b]) for a, b in itertools.pairwise(edges)
    )
    assert picked == b"?!~"
    assert taken(device) == [b"G1 X1", b"G1X2", b"", b"(long comment)", b"M5", b"$H"]
    assert device.overruns == 0
    assert device.free_rx_bytes == device.rx_bytes - dialect.rx_report_margin


@BOTH
def test_a_busy_controllers_buffer_fills_overruns_and_counts(dialect):
    device = GrblDevice(dialect, rx_bytes=32)
    shown_empty = 32 - dialect.rx_report_margin
    device.receive_data(b"G4 P1\n")
    assert device.pop_line() == b"G4 P1"  # the controller is busy with it
    assert device.free_rx_bytes == shown_empty
    device.receive_data(b"G1 X123456\n")
    device.receive_data(b"G1 X12")
    assert device.free_rx_bytes == shown_empty - 17
    device.receive_data(b"3456\nG1 Y1")  # 31 bytes are usable, 28 are taken after this
    assert (device.overruns, device.free_rx_bytes) == (0, shown_empty - 27)
    device.receive_data(b"2345678\n")
    assert device.overruns == 4
    assert device.receive_data(b"!") == b"!"  # real-time bytes need no room
    assert device.pop_line() == b"G1 X123456"
    assert device.free_rx_bytes == shown_empty - 31 + 11
    device.receive_data(b"\n")
    assert taken(device) == [b"G1 X123456", b"G1 Y12345"[:9]]
    assert device.free_rx_bytes == shown_empty


@BOTH
def test_an_idle_controller_reads_a_line_longer_than_its_buffer(dialect):
    device = GrblDevice(dialect, rx_bytes=16)
    assert device.pop_line() is None
    for _ in range(10):
        device.receive_data(b"(comment)")
    device.receive_data(b"M5\n")
    assert device.overruns == 0
    assert taken(device) == [b"(comment)" * 10 + b"M5"]


def test_a_line_is_too_long_by_what_is_stored_of_it():
    device = GrblDevice(GRBL)
    assert device.pop_line() is None
    device.receive_data(b"X" * 79 + b"\n")
    assert not device.is_line_too_long(device.pop_line())
    assert device.pop_line() is None
    device.receive_data(b"X" * 80 + b"\n")
    assert device.is_line_too_long(device.pop_line())
    assert device.pop_line() is None
    device.receive_data(b" " * 30 + b"X" * 40 + b"(" + b"c" * 30 + b")\n")
    assert not device.is_line_too_long(device.pop_line())


def test_an_endless_line_is_bounded_and_too_long():
    device = GrblDevice(GRBLHAL)
    assert device.pop_line() is None
    for _ in range(3000):
        device.receive_data(b"(endless comment")
        assert device.pop_line() is None
    assert len(device._partial) < 5000
    device.receive_data(b")\nM5\n")
    assert device.is_line_too_long(device.pop_line())
    assert device.pop_line() == b"M5"
    assert device.free_rx_bytes == 1023


@BOTH
def test_a_reset_byte_empties_the_buffer_of_what_stood_before_it(dialect):
    device = GrblDevice(dialect)
    device.receive_data(b"G1 X1\nG1 X")
    assert device.receive_data(b"2\nG1 X3\n?\x18$X\n") == b"?\x18"
    assert taken(device) == [b"$X"]


def test_messages_go_out_with_crlf_and_a_banner_after_an_empty_line():
    device = GrblDevice(GRBL)
    assert device.encode_message(OkReply()) == b"ok\r\n"
    assert device.encode_message(WelcomeBanner(GRBL.banner)) == b"\r\nGrbl 1.1h ['$' for help]\r\n"


@BOTH
def test_both_ends_joined_keep_count_without_overrun(dialect):
    """A host that fills the window and a controller that takes a line now and then."""
    device = GrblDevice(dialect, rx_bytes=128)
    host = GrblHost(127, 79)
    lines = [b"N%d G1 X%d.%03d Y1" % (n, n, n % 1000) for n in range(500)]
    waiting = list(enumerate(lines))
    executed, answered = [], []
    while len(answered) < len(lines):
        out = b""
        while waiting and host.can_send(waiting[0][1]):
            tag, line = waiting.pop(0)
            out += host.send_line(line, tag)
        device.receive_data(out)
        for _ in range(2):
            if (line := device.pop_line()) is not None:
                executed.append(line)
                reply = ErrorReply(20) if len(executed) % 7 == 0 else OkReply()
                answered += host.receive_data(device.encode_message(reply))
    assert executed == lines
    assert answered == [LineRejected(n, 20) if n % 7 == 6 else n for n in range(500)]
    assert (device.overruns, host.free_rx_bytes) == (0, 127)
    assert host.receive_data(device.encode_message(WelcomeBanner(dialect.banner))) == [
        ControllerRestarted(dialect.banner, ())
    ]


@BOTH
@given(data=st.binary(max_size=400))
def test_any_bytes_are_taken_and_the_buffer_keeps_its_books(dialect, data):
    device = GrblDevice(dialect, rx_bytes=64)
    for at in range(0, len(data), 7):
        device.receive_data(data[at : at + 7])
        if at % 3 == 0:
            device.pop_line()
        assert 0 <= device.free_rx_bytes <= 64
    taken(device)
    assert device.free_rx_bytes == 64 - dialect.rx_report_margin
    assert RealtimeCommand.RESET.encoded == b"\x18"
