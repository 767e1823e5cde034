"""Both ends of the motion codec under damage: what the real firmwares said, flipped, cut, repeated.

The oracle counts whole answer lines by itself; a line is credited by one of those or not at all.
"""

from __future__ import annotations

import itertools
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import GRBL, GRBLHAL
from firmware_protocol.host import ControllerRestarted, GrblHost, LineRejected, RemoteProtocolError
from firmware_protocol.realtime import RealtimeCommand

LINES = 40
ANSWER = re.compile(rb"(?:ok|error:\d+)\r?")


@pytest.fixture(scope="module", params=["grbl", "grblhal"])
def recorded(request, scenarios) -> bytes:
    """All that one firmware said in all scenarios, as bytes."""
    said = [line for s in scenarios if s.dialect == request.param for line in s.received]
    return "".join(f"{line}\r\n" for line in said).encode("latin-1")


def followed(parts: list[bytes]) -> list:
    """Events of a host with many lines under way; its books are checked on the way."""
    host = GrblHost(LINES * 6, 79)
    for tag in range(LINES):
        host.send_line(b"G1 X1", tag)
    events = []
    for part in parts:
        events += host.receive_data(part)
        assert host.free_rx_bytes == 6 * (LINES - host.unanswered_lines)
    answered = [
        e if isinstance(e, int) else e.tag for e in events if isinstance(e, int | LineRejected)]
    given_up = [tag for event in events if isinstance(
        event, ControllerRestarted) for tag in event.unanswered_tags]
    reported = [*answered, *given_up]
    assert sorted(reported) == list(range(len(reported)))  # each line ends once, the oldest first
    assert answered == sorted(answered)
    assert host.unanswered_lines == LINES - len(reported)
    return events


def answers(events: list) -> int:
    """Answers the host took for such, those to no line included."""
    return sum(isinstance(event, int | LineRejected | RemoteProtocolError) for event in events)


def whole_answers(data: bytes) -> int:
    """Lines of a byte stream that are an answer, by a reading of our own."""
    return sum(ANSWER.fullmatch(line) is not None for line in data.split(b"\n")[:-1])


def test_any_bit_flipped_credits_only_what_still_reads_as_an_answer(recorded):
    data = bytearray(recorded[-300:])
    whole = answers(followed([bytes(data)]))
    for at, bit in itertools.product(range(len(data)), range(8)):
        data[at] ^= 1 << bit
        found = answers(followed([bytes(data)]))
        assert found == whole_answers(bytes(data))
        assert found <= whole + 1  # a flip may part one line into two, and never makes more
        data[at] ^= 1 << bit


def test_cut_at_any_byte_it_credits_the_answers_before_the_cut(recorded):
    data = recorded[-600:]
    for at in range(len(data)):
        assert answers(followed([data[:at]])) == whole_answers(data[:at])
        # The first half of a line runs into what comes after the gap.
        rest = data[:at] + data[at + 40 :]
        assert answers(followed([data[:at], data[at + 40 :]])) == whole_answers(rest)


@settings(max_examples=40)
@given(data=st.data())
def test_chunks_repeated_dropped_flipped_and_swapped(recorded, data):
    start = data.draw(st.integers(0, len(recorded) - 800))
    stream = bytearray(recorded[start : start + 800])
    for _ in range(data.draw(st.integers(0, 6))):
        stream[data.draw(st.integers(0, 799))] ^= 1 << data.draw(st.integers(0, 7))
    places = sorted(data.draw(st.lists(st.integers(0, 800), max_size=8)))
    parts = [bytes(stream[a:b]) for a, b in itertools.pairwise([0, *places, 800])]
    order = data.draw(st.lists(st.integers(0, len(parts) - 1), max_size=2 * len(parts)))
    parts = [parts[at] for at in order]  # any chunk once, twice or never, in any order
    assert answers(followed(parts)) == whole_answers(b"".join(parts))
    bytewise = [bytes((byte,)) for byte in b"".join(parts)]
    assert followed(bytewise) == followed([b"".join(parts)])


@settings(max_examples=40)
@given(noise=st.binary(max_size=400), data=st.data())
def test_noise_costs_at_most_the_line_it_runs_into(recorded, noise, data):
    at = data.draw(st.integers(0, len(recorded) - 1))
    rest = b"\r\n" + recorded[at:]
    events = followed([noise, rest])
    assert answers(events) == whole_answers(noise + rest)
    assert answers(events) >= whole_answers(recorded[at:])


# the device's end --------------------------------------------------------------------------------

PROGRAM = b"".join(b"N%d G1 X%.3f Y5 F600 S%d\n" % (n, n / 7, n) for n in range(60))


@pytest.mark.parametrize("dialect", [GRBL, GRBLHAL], ids=lambda dialect: dialect.name)
@settings(max_examples=40)
@given(data=st.data())
def test_a_device_takes_damaged_programs_the_same_however_they_are_chopped(dialect, data):
    stream = bytearray(PROGRAM)
    for _ in range(data.draw(st.integers(0, 8))):
        stream[data.draw(st.integers(0, len(stream) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    # A reset forgets what stands before it, which depends on what was taken by then.
    stream = stream.replace(bytes((RealtimeCommand.RESET,)), b"")
    places = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    parts = [bytes(stream[a:b]) for a, b in itertools.pairwise([0, *places, len(stream)])]

    def taken(parts: list[bytes]) -> tuple[list, bytes, int]:
        device = GrblDevice(dialect, 100_000)
        lines, realtime = [], b""
        for part in parts:
            realtime += device.receive_data(part)
            while (line := device.pop_line()) is not None:
                lines.append(line)
        return lines, realtime, device.overruns

    lines, realtime, overruns = taken(parts)
    assert (lines, realtime, overruns) == taken([bytes(stream)])
    assert overruns == 0
    ends = sum(bytes(stream).count(end) for end in (b"\n", b"\r"))
    assert len(lines) == ends
    assert len(realtime) + sum(len(line) + 1 for line in lines) <= len(stream)


@settings(max_examples=40)
@given(chunks=st.lists(st.binary(max_size=300), max_size=8), rx_bytes=st.sampled_from([64, 128]))
def test_a_device_that_never_reads_loses_what_does_not_fit_and_counts_it(chunks, rx_bytes):
    device = GrblDevice(GRBL, rx_bytes)
    device.receive_data(b"G1 X1\n")  # the line under way: no more is read
    assert device.pop_line() is not None
    came = 0
    for chunk in chunks:
        chunk = chunk.translate(None, bytes((*range(0x80, 0x100), *b"!?~\x18")))
        device.receive_data(chunk)
        came += len(chunk)
    kept = device.rx_bytes - device.dialect.rx_report_margin - device.free_rx_bytes
    assert 0 <= device.free_rx_bytes <= rx_bytes
    assert device.overruns <= came
    assert kept + device.overruns <= came
    assert kept < rx_bytes
