"""Frames of Modbus RTU and Modbus TCP, as a host needs them: one request out, its answer found.

A line may carry more than the answer: stray bytes of a switching transceiver, an echo of the
request, a late answer to an earlier request. The finder therefore looks at every byte as a possible
beginning, and accepts only what carries the device id, the function code, the length and the
checksum (RTU) or the transaction number (TCP) of the request that is open.
Source: MODBUS over Serial Line V1.02 (2.5.1), MODBUS Messaging on TCP/IP V1.0b (3.1).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from pymodbus.framer import FramerRTU

from lmctl.machine.modbus.observation import WireObservation

#: Flag that a device sets in the function code of an exception.
EXCEPTION_FLAG = 0x80
_READ_FUNCTIONS = (1, 2, 3, 4, 23)
_WRITE_FUNCTIONS = (6, 15, 16)
_MBAP = 6  # bytes before the unit id of a TCP frame
_MAX_TCP_BODY = 254


class SentRequest(NamedTuple):
    """A request that is open.

    frame : the bytes sent
    transaction_number : transaction number, TCP only
    answer_bytes : length of its regular answer, function code included
    """

    frame: bytes
    device_id: int
    function_code: int
    transaction_number: int
    answer_bytes: int


class Framing(Protocol):
    """One way to put a PDU (function code and data) on a wire."""

    def encode(self, pdu: bytes, device_id: int, number: int) -> bytes:
        """The bytes of one frame."""

    def find_answer(self, received: bytes, sent: SentRequest) -> bytes | None:
        """The PDU that answers the request, an exception included; None while there is none."""

    def count_unexpected_bytes(self, received: bytes, sent: SentRequest,
                               seen: WireObservation) -> None:
        """Count what came instead of an answer."""


class RtuFraming:
    """Modbus RTU: device id, PDU, CRC-16 with the low byte first.

    It learns from the first echo that its line echoes: then an answer is looked for behind the echo
    only, since a part of a written request may look like the answer to it.
    """

    def __init__(self) -> None:
        self._line_echoes = False

    def encode(self, pdu: bytes, device_id: int, number: int) -> bytes:
        return _with_checksum(bytes((device_id,)) + pdu)

    def find_answer(self, received: bytes, sent: SentRequest) -> bytes | None:
        at = self._end_of_echo(received, sent)
        if self._line_echoes and not at:
            return None
        id_byte = bytes((sent.device_id,))
        while 0 <= (at := received.find(id_byte, at)) < len(received) - 4:
            code = received[at + 1]
            if code == sent.function_code:
                size = sent.answer_bytes + 3
            elif code == sent.function_code | EXCEPTION_FLAG:
                size = 5
            else:
                size = 0
            frame = received[at : at + size]
            if size and len(frame) == size and _is_intact(frame):
                return frame[1:-2]
            at += 1
        return None

    def count_unexpected_bytes(self, received: bytes, sent: SentRequest,
                               seen: WireObservation) -> None:
        echo_end = self._end_of_echo(received, sent)
        self._line_echoes = echo_end > 0
        if echo_end:
            seen.echo_count += 1
            received = received[echo_end:]
        at, stray = 0, 0
        while at < len(received):
            size = next((s for s in _rtu_sizes(received[at:])
                         if _is_intact(received[at : at + s])), 0)
            if size:
                self._count_intact(received[at : at + size], sent, seen)
            elif _begins_answer(received[at:], sent):
                seen.damaged_frame_count += 1
                size = len(received) - at
            stray += not size
            at += size or 1
        seen.stray_byte_count += stray

    def _end_of_echo(self, received: bytes, sent: SentRequest) -> int:
        """Where the echo of the request ends, 0 where there is none."""
        at = received.find(sent.frame)
        if at < 0:
            return 0
        self._line_echoes = True
        return at + len(sent.frame)

    @staticmethod
    def _count_intact(frame: bytes, sent: SentRequest, seen: WireObservation) -> None:
        if frame[0] != sent.device_id:
            seen.other_ids.add(frame[0])
        elif frame[1] & ~EXCEPTION_FLAG == sent.function_code and (
            len(frame) in (sent.answer_bytes + 3, 5)
        ):
            seen.late_answer_count += 1
        else:
            seen.unexpected_answer_count += 1


class TcpFraming:
    """Modbus TCP: transaction number, protocol 0, length, unit id, PDU."""

    def encode(self, pdu: bytes, device_id: int, number: int) -> bytes:
        header = number.to_bytes(2, "big") + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big")
        return header + bytes((device_id,)) + pdu

    def find_answer(self, received: bytes, sent: SentRequest) -> bytes | None:
        header = sent.transaction_number.to_bytes(2, "big") + b"\0\0"
        at = -1
        while (at := received.find(header, at + 1)) >= 0:
            frame = _tcp_frame(received[at:])
            if frame is not None and frame != sent.frame and _is_tcp_answer(frame, sent):
                return frame[_MBAP + 1:]
        return None

    def count_unexpected_bytes(self, received: bytes, sent: SentRequest,
                               seen: WireObservation) -> None:
        at = 0
        while at < len(received):
            frame = _tcp_frame(received[at:])
            if frame is None:
                seen.stray_byte_count += 1
                at += 1
                continue
            at += len(frame)
            if frame == sent.frame:
                seen.echo_count += 1
            elif frame[_MBAP] != sent.device_id:
                seen.other_ids.add(frame[_MBAP])
            elif _is_tcp_answer(frame, sent):
                seen.late_answer_count += 1
            else:
                seen.unexpected_answer_count += 1


def _begins_answer(data: bytes, sent: SentRequest) -> bool:
    """Whether data begin as an answer to the request does; it was torn or damaged."""
    return len(data) >= 3 and data[0] == sent.device_id and (
        data[1] & ~EXCEPTION_FLAG == sent.function_code
    )


def _rtu_sizes(data: bytes) -> Iterator[int]:
    """The lengths that an RTU frame at the beginning of data may have."""
    if len(data) < 5 or not 1 <= data[0] <= 247:
        return
    code = data[1]
    if code & EXCEPTION_FLAG:
        sizes: tuple[int, ...] = (5,)
    elif code in _READ_FUNCTIONS:
        sizes = (5 + data[2], 8)  # an answer, or another host's request
    elif code in _WRITE_FUNCTIONS:
        sizes = (8,)
    else:
        sizes = ()
    yield from (size for size in sizes if size <= len(data))


def _tcp_frame(data: bytes) -> bytes | None:
    """The whole TCP frame at the beginning of data, or None."""
    if len(data) < _MBAP + 2 or data[2:4] != b"\0\0":
        return None
    length = int.from_bytes(data[4:6], "big")
    if length == 2 and data[_MBAP + 1] & EXCEPTION_FLAG:
        length = 3  # some gateways leave the code of an exception out of its length
    frame = data[: _MBAP + length]
    return frame if 3 <= length <= _MAX_TCP_BODY and len(frame) == _MBAP + length else None


def _is_tcp_answer(frame: bytes, sent: SentRequest) -> bool:
    unit, code, size = frame[_MBAP], frame[_MBAP + 1], len(frame) - _MBAP - 1
    if unit != sent.device_id:
        return False
    if code == sent.function_code | EXCEPTION_FLAG:
        return size == 2
    return code == sent.function_code and size == sent.answer_bytes and (
        code not in _READ_FUNCTIONS or frame[_MBAP + 2] == size - 2
    )


def _with_checksum(data: bytes) -> bytes:
    checksum: int = FramerRTU.compute_CRC(data)  # the low byte is already first
    return data + checksum.to_bytes(2, "big")


def _is_intact(frame: bytes) -> bool:
    return _with_checksum(frame[:-2]) == frame
