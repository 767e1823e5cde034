"""Answers found in what a wire carries: whole, byte by byte, behind garbage, beside an echo."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    ReadInputRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
)

from lmctl.machine.modbus.framing import RtuFraming, SentRequest, TcpFraming
from lmctl.machine.modbus.observation import WireObservation

words = st.integers(0, 0xFFFF)
exchanges = st.one_of(
    st.tuples(st.just("read input"), st.lists(words, min_size=1, max_size=30)),
    st.tuples(st.just("read holding"), st.lists(words, min_size=1, max_size=30)),
    st.tuples(st.just("write"), st.lists(words, min_size=1, max_size=30)),
    st.tuples(st.just("exception"), st.integers(1, 11)),
)


def pymodbus_frames(wire, device_id, number, address, kind, content):
    """(request, regular answer's bytes, answer), framed by the other library."""
    framer = (FramerSocket if wire == "tcp" else FramerRTU)(DecodePDU(False))
    count = len(content) if isinstance(content, list) else 3
    if kind == "write":
        request = WriteMultipleRegistersRequest(address=address, registers=content)
        answer, size = WriteMultipleRegistersResponse(address=address, count=count), 5
    elif kind == "read holding":
        request = ReadHoldingRegistersRequest(address=address, count=count)
        answer, size = ReadHoldingRegistersResponse(registers=content), 2 + 2 * count
    else:
        request = ReadInputRegistersRequest(address=address, count=count)
        answer, size = ReadInputRegistersResponse(registers=content if kind != "exception" else []
                                                  ), 2 + 2 * count
    if kind == "exception":
        answer = ExceptionResponse(4, content)
    for message in (request, answer):
        message.dev_id, message.transaction_id = device_id, number
    return framer.buildFrame(request), size, framer.buildFrame(answer)


def framing_of(wire):
    return TcpFraming() if wire == "tcp" else RtuFraming()


def opened(wire, frame, number, size):
    start = 7 if wire == "tcp" else 1
    return SentRequest(frame, frame[start - 1], frame[start], number, size)


def pdu_of(wire, frame):
    return frame[7:] if wire == "tcp" else frame[1:-2]


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
@settings(max_examples=60, deadline=None)
@given(exchange=exchanges, device_id=st.integers(1, 247), number=st.integers(1, 0xFFFF),
       address=st.integers(0, 2000), before=st.binary(max_size=40), echoed=st.booleans(),
       data=st.data())
def test_an_answer_is_found_whatever_stands_before_it(
    wire, exchange, device_id, number, address, before, echoed, data
):
    kind, content = exchange
    request, size, answer = pymodbus_frames(wire, device_id, number, address, kind, content)
    framing, sent = framing_of(wire), opened(wire, request, number, size)
    assert framing.encode(pdu_of(wire, request), device_id, number) == request
    # Garbage that begins as an answer does is the hardest. (Modbus TCP has no checksum: behind the
    # function code nothing tells a torn answer from a whole one.)
    if data.draw(st.booleans()):
        before += answer[: data.draw(st.integers(0, 7 if wire == "tcp" else len(answer) - 1))]
    stream = (request if echoed else b"") + before + answer
    for end in range(len(stream)):  # byte by byte: never sooner than whole
        assert framing.find_answer(stream[:end], sent) is None
    assert framing.find_answer(stream, sent) == pdu_of(wire, answer)
    assert framing.find_answer(stream + b"\x55\xaa", sent) == pdu_of(wire, answer)


@settings(max_examples=60, deadline=None)
@given(exchange=exchanges, device_id=st.integers(1, 247), at=st.integers(0, 1000),
       bit=st.integers(0, 7))
def test_no_rtu_answer_with_a_flipped_bit_is_taken(exchange, device_id, at, bit):
    kind, content = exchange
    request, size, answer = pymodbus_frames("rtu", device_id, 0, 100, kind, content)
    damaged = bytearray(answer)
    damaged[at % len(answer)] ^= 1 << bit
    sent = opened("rtu", request, 0, size)
    assert RtuFraming().find_answer(bytes(damaged), sent) is None
    assert RtuFraming().find_answer(bytes(damaged) + answer, sent) == answer[1:-2]


def test_on_a_line_that_echoes_the_beginning_of_an_echo_is_no_answer():
    """Eight bytes of a write are the answer to it where its count and data equal a checksum."""
    answer = RtuFraming().encode(bytes((16, 0, 1, 0, 35)), 1, 0)
    request = RtuFraming().encode(bytes((16, 0, 1, 0, 35)) + answer[-2:] + bytes(69), 1, 0)
    sent = SentRequest(request, 1, 16, 0, 5)
    assert RtuFraming().find_answer(answer, sent) == answer[1:-2]  # a line without echo
    framing = RtuFraming()
    reading, size, registers = pymodbus_frames("rtu", 1, 0, 0, "read input", [1, 2])
    assert framing.find_answer(reading + registers, opened("rtu", reading, 0, size))
    for end in range(len(request) + 1):
        assert framing.find_answer(request[:end], sent) is None
    assert framing.find_answer(request + answer, sent) == answer[1:-2]
    # it echoes no longer
    framing.count_unexpected_bytes(b"\x00", sent, WireObservation(1, True, 0.5))
    assert framing.find_answer(answer, sent) == answer[1:-2]


def seen_of(wire, received, number=7, device_id=1):
    request, size, answer = pymodbus_frames(wire, device_id, number, 0, "read input", [1, 2, 3])
    seen = WireObservation(device_id, wire == "rtu", 0.5)
    framing_of(wire).count_unexpected_bytes(received(request, answer),
                                            opened(wire, request, number, size), seen)
    seen.unanswered_request_count, seen.bytes_received = 1, len(received(request, answer))
    return seen


def of_id(wire, device_id, number=7):
    return pymodbus_frames(wire, device_id, number, 0, "read input", [1, 2, 3])[2]


@pytest.mark.parametrize(("wire", "received", "words", "hint"), [
    ("rtu", lambda q, a: b"", "no byte came back in 1 request", "device_id, baud rate"),
    ("tcp", lambda q, a: b"", "connected, but no byte came back", "gateway"),
    ("rtu", lambda q, a: q, "only the echo of 1 request", "device's power"),
    ("rtu", lambda q, a: of_id("rtu", 7), "device id 7 answers, and id 1 was asked",
     "device_id = 7"),
    ("tcp", lambda q, a: of_id("tcp", 7), "device id 7 answers, and id 1 was asked",
     "device_id = 7"),
    ("rtu", lambda q, a: a[:-1] + b"\x00", "1 answer came damaged", "shielding"),
    ("rtu", lambda q, a: a[:-3], "1 answer came damaged", "shielding"),
    ("rtu", lambda q, a: b"\xfe\x80\xf8\x00\xe0", "5 bytes came that are no Modbus frame",
     "baud rate, parity"),
    ("tcp", lambda q, a: b"HTTP/1.1 400", "12 bytes came that are no Modbus frame", "port"),
    ("rtu", lambda q, a: a, "1 answer came later than 0.5 s", "timeout_s"),
    ("tcp", lambda q, a: of_id("tcp", 1, 6), "1 answer came later than 0.5 s", "timeout_s"),
])
def test_each_cause_of_silence_reads_differently(wire, received, words, hint):
    seen = seen_of(wire, received)
    assert words in seen.description
    assert hint in seen.hint
