"""The host end: character counting and acknowledgements under every kind of arrival."""

from __future__ import annotations

import itertools
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.host import (
    MAX_LINE_BYTES,
    ControllerRestarted,
    GrblHost,
    LineRejected,
    LocalProtocolError,
    RemoteProtocolError,
)
from firmware_protocol.messages import AlarmMessage, FeedbackMessage, StatusMessage, UnknownMessage

STREAM = (
    b"ok\r\n<Run|MPos:1.000,0.000,0.000|Bf:14,128>\r\nok\r\nerror:20\r\n[MSG:Pgm End]\r\nok\n"
    b"\xff\x00garbage\r\nok\r\n"
)


def host_with(lines: int, rx_usable: int = 127) -> GrblHost:
    host = GrblHost(rx_usable, 79)
    for tag in range(lines):
        host.send_line(b"G1 X1", tag)
    return host


def cut(data: bytes, places: list[int]) -> list[bytes]:
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


def test_whole_byte_by_byte_and_every_single_cut_give_the_same_events():
    whole = host_with(6).receive_data(STREAM)
    assert [event for event in whole if isinstance(event, int | LineRejected)] == [
        0, 1, LineRejected(2, 20), 3, 4,
    ]
    assert isinstance(whole[1], StatusMessage)
    assert whole[4] == FeedbackMessage("MSG", "Pgm End")
    assert whole[6] == UnknownMessage("\xff\x00garbage")

    host = host_with(6)
    assert [e for byte in STREAM for e in host.receive_data(bytes((byte,)))] == whole
    for place in range(len(STREAM)):
        host = host_with(6)
        assert host.receive_data(STREAM[:place]) + host.receive_data(STREAM[place:]) == whole


@given(st.lists(st.integers(min_value=0), max_size=12))
def test_any_cutting_gives_the_same_events(places):
    host = host_with(6)
    events = [e for part in cut(STREAM, places) for e in host.receive_data(part)]
    assert events == host_with(6).receive_data(STREAM)


def test_trailing_bytes_wait_for_their_line_end():
    host = host_with(2)
    assert host.receive_data(b"ok\r\no") == [0]
    assert host.receive_data(b"k\r") == []
    assert host.receive_data(b"\n") == [1]


def test_counting_fills_the_buffer_to_the_byte_and_answers_free_it():
    host = GrblHost(20, 79)
    assert host.send_line(b"G1 X12345", 1) == b"G1 X12345\n"
    assert host.can_send(b"G1 X54321")
    assert not host.can_send(b"G1 X543210")
    host.send_line(b"G1 X54321", 2)
    assert (host.free_rx_bytes, host.unanswered_lines) == (0, 2)
    assert not host.can_send(b"")
    with pytest.raises(LocalProtocolError, match="needs 1 bytes, 0 are free"):
        host.send_line(b"", 3)
    host.receive_data(b"error:9\r\n")
    assert (host.free_rx_bytes, host.unanswered_lines) == (10, 1)
    host.receive_data(b"ok\r\n")
    assert (host.free_rx_bytes, host.unanswered_lines) == (20, 0)


@pytest.mark.parametrize(
    "line", [b"G1\nX1", b"G1\r", b"(what?)", b"!", b"~", b"\x18", b"(\xc2\xb5)"]
)
def test_bytes_that_would_act_or_break_a_line_are_our_bug(line):
    host = GrblHost(127, 79)
    with pytest.raises(LocalProtocolError, match="would act or break"):
        host.send_line(line, 1)
    assert host.free_rx_bytes == 127


def test_a_line_longer_than_the_firmware_takes_is_our_bug():
    host = GrblHost(1023, 79)
    host.send_line(b"X" * 79, 1)
    with pytest.raises(LocalProtocolError, match="80 characters"):
        host.send_line(b"X" * 80, 1)


@given(st.lists(st.binary(max_size=12) | st.sampled_from([b"G1 X1", b"", b"X" * 10, b"X" * 11]),
                max_size=6))
def test_lines_are_refused_together_where_one_of_them_is(lines):
    host = GrblHost(127, 10)

    def refused(check, *what):
        try:
            check(*what)
        except LocalProtocolError as error:
            return str(error)
        return None

    one_by_one = [found for line in lines if (found := refused(host.check_line, line))]
    assert refused(host.check_lines, lines) == next(iter(one_by_one), None)


def test_of_the_lines_that_wait_as_many_are_sent_as_there_is_room_for():
    host, waiting = GrblHost(20, 79), deque([b"G1 X12345", b"", b"G1 X5432", b"G1 X1"])
    assert host.send_queued(waiting, 7) == [b"G1 X12345", b"", b"G1 X5432"]
    assert (host.free_rx_bytes, host.oldest_unanswered_tag, host.newest_unanswered_tag) == (0, 7, 9)
    assert host.send_queued(waiting, 10) == []
    assert host.receive_data(b"ok\r\nok\r\n") == [7, 8]
    assert host.send_queued(waiting, 10) == [b"G1 X1"]
    assert (host.free_rx_bytes, host.unanswered_lines, list(waiting)) == (5, 2, [])


@pytest.mark.parametrize("answer", [b"ok\r\n", b"error:2\r\n"])
def test_an_answer_to_nothing_is_reported_and_credits_nothing(answer):
    host = GrblHost(127, 79)
    (event,) = host.receive_data(answer)
    assert isinstance(event, RemoteProtocolError)
    host.send_line(b"G1 X1", 7)
    assert host.free_rx_bytes == 121


def test_a_banner_in_mid_stream_ends_every_outstanding_line():
    host = host_with(3)
    events = host.receive_data(b"ok\r\n\r\nGrbl 1.1h ['$' for help]\r\nok\r\nALARM:1\r\n")
    assert events == [
        0,
        ControllerRestarted("Grbl 1.1h ['$' for help]", (1, 2)),
        RemoteProtocolError("ok", "it answers no line that was sent"),
        AlarmMessage(1),
    ]
    assert (host.free_rx_bytes, host.unanswered_lines) == (127, 0)


def test_an_endless_line_is_bounded_and_one_event_and_its_end_is_no_answer():
    host = host_with(2)
    events = [e for _ in range(5000) for e in host.receive_data(b"x" * 50)]
    assert events == [UnknownMessage("x" * MAX_LINE_BYTES)]
    assert len(host._partial) <= MAX_LINE_BYTES + 50
    assert host.receive_data(b"ok\r\nok\r\n") == [0]
    assert host.receive_data(b"y" * 3000 + b"\nok\r\n") == [
        UnknownMessage("y" * MAX_LINE_BYTES),
        1,
    ]


@given(st.data())
def test_no_damage_credits_a_line_that_was_not_answered(data):
    """Cut, repeated and flipped streams: credits never exceed whole `ok`/`error:N` lines."""
    stream = bytearray(STREAM * 2)
    for _ in range(data.draw(st.integers(0, 4))):
        stream[data.draw(st.integers(0, len(stream) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    places = data.draw(st.lists(st.integers(0, len(stream)), max_size=6))
    parts = cut(bytes(stream), places)
    again = data.draw(st.integers(0, len(parts) - 1))
    parts.insert(again, parts[again])
    host = host_with(20, 1023)
    events = [e for part in parts for e in host.receive_data(part)]
    answers = sum(
        line.removesuffix(b"\r") == b"ok" or line.startswith(b"error:")
        for line in b"".join(parts).split(b"\n")[:-1]
    )
    tags = [e if isinstance(e, int) else e.tag for e in events if isinstance(e, int | LineRejected)]
    assert tags == list(range(len(tags)))
    assert len(tags) <= answers
    assert host.unanswered_lines == 20 - len(tags)
    assert host.free_rx_bytes == 1023 - 6 * host.unanswered_lines


@given(st.binary(max_size=300))
def test_any_bytes_are_taken(data):
    host = host_with(3)
    host.receive_data(data)
    host.receive_data(b"\n")
    assert 0 <= host.free_rx_bytes <= 127


def test_every_scenario_of_both_firmwares_is_followed_answer_by_answer(scenarios):
    """Answers fall to lines in order; where a banner comes, what is outstanding is given up."""
    checked = 0
    for scenario in scenarios:
        lines = [write[:-1] for write in scenario.sent if write.endswith(b"\n")]
        lines = [line.replace(b"?", b"") for line in lines]  # `?` + newline: the newline is a line
        resets = sum("Grbl" in line for line in scenario.received)
        # A scenario that begins with a reset sends its lines after the banner.
        begun = 2 if scenario.sent[0] == b"\x18" else 0
        parts = ["".join(f"{line}\r\n" for line in scenario.received[begun:]).encode()]

        def events(parts: list[bytes], lines: list[bytes] = lines) -> list:
            host = GrblHost(100_000, 256)
            for tag, line in enumerate(lines):
                host.send_line(line, tag)
            return [event for part in parts for event in host.receive_data(part)]

        whole = events(parts)
        assert whole == events([bytes((byte,)) for byte in parts[0]])
        assert not any(isinstance(event, UnknownMessage) for event in whole)
        if resets == (begun > 0):
            said = [line for line in scenario.received if line == "ok" or line[:6] == "error:"]
            assert [event for event in whole if isinstance(event, int | LineRejected)] == [
                tag if line == "ok" else LineRejected(tag, int(line[6:]))
                for tag, line in enumerate(said)
            ]
            checked += len(said)
    assert checked > 150
