"""What a host sees on a Modbus wire while a device does not answer, and what that points to.

A dead cable, a wrong baud rate, a wrong device id and a noisy line all look the same to a host
waiting for an answer. The bytes that come instead distinguish them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

_CHECK_LINE = "check cable, shielding, termination and grounding of the line"


@dataclass
class WireObservation:
    """Counts since the last good answer.

    is_serial : the wire is a serial line (RTU), not a network connection (TCP)
    unanswered_request_count : requests sent without a usable answer
    unconnected_request_count : requests that found no connection
    bytes_received : all of them
    echo_count : requests that came back as they were sent
    other_ids : device ids of intact frames that are not the one asked
    damaged_frame_count : answers with a wrong checksum, or cut short
    late_answer_count : answers that came after their time
    unexpected_answer_count : intact frames of the device that answer another question
    stray_byte_count : bytes that belong to no frame
    passing_exception_counts : how often each came, by its text: a busy device, or a gateway that
        cannot reach it
    """

    device_id: int
    is_serial: bool
    timeout_s: float
    unanswered_request_count: int = 0
    unconnected_request_count: int = 0
    bytes_received: int = 0
    echo_count: int = 0
    other_ids: set[int] = field(default_factory=set)
    damaged_frame_count: int = 0
    late_answer_count: int = 0
    unexpected_answer_count: int = 0
    stray_byte_count: int = 0
    passing_exception_counts: dict[str, int] = field(default_factory=dict)

    @property
    def has_anomalies(self) -> bool:
        """Whether something has gone wrong at all."""
        return bool(
            self.unanswered_request_count or self.unconnected_request_count or self.bytes_received
                    or self.passing_exception_counts or self.damaged_frame_count)

    @property
    def description(self) -> str:
        """What was seen, in words, e.g. "no byte came back in 3 requests"."""
        return "; ".join(sentence for sentence, _ in self._findings())

    @property
    def hint(self) -> str:
        """What to check first, by what was seen."""
        return next(hint for _, hint in self._findings())

    def _findings(self) -> Iterator[tuple[str, str]]:
        """What was seen and what to do about it, the most telling first; at least one."""
        found = False
        for applies, sentence, hint in self._cases():
            if applies:
                found = True
                yield sentence, hint
        if found:
            return
        unconnected = self.unconnected_request_count
        if unconnected and unconnected >= self.unanswered_request_count:
            yield ("there is no connection",
                   "check the port and its adapter" if self.is_serial else
                   "check power, network cable and address")
        elif self.is_serial:
            yield (f"no byte came back in {_count(self.unanswered_request_count, 'request')}",
                   "check power and cable, whether A and B are swapped, then device_id, baud rate "
                   "and parity: a device that does not understand a request stays silent")
        else:
            yield ("it is connected, but no byte came back in "
                   f"{_count(self.unanswered_request_count, 'request')}",
                   "check device_id, that no other host is connected to it, and the gateway before "
                   "it")

    def _cases(self) -> Iterator[tuple[object, str, str]]:
        """For each case: whether it applies, its description, and what to do."""
        ids = " and ".join(map(str, sorted(self.other_ids)))
        yield (self.passing_exception_counts,
               "; ".join(f"{words}, {_count(number, 'time')}"
                         for words, number in self.passing_exception_counts.items()),
               "check the device behind the gateway, the line between them, and device_id")
        yield (self.other_ids,
               f"device id {ids} answers, and id {self.device_id} was asked",
               f"set device_id = {min(self.other_ids, default=0)} if that is the device")
        yield (self.damaged_frame_count,
               f"{_count(self.damaged_frame_count, 'answer')} came damaged (checksum or length)",
               _CHECK_LINE)
        yield (self.late_answer_count,
               f"{_count(self.late_answer_count, 'answer')} came later than {self.timeout_s:g} s",
               "raise timeout_s of the device, and what its cycle depends on")
        yield (self.unexpected_answer_count,
               f"{_count(self.unexpected_answer_count, 'answer')} came to other questions",
               "is another host connected to the same line?")
        yield (self.echo_count and self.bytes_received and not self._is_more_than_echo,
               f"only the echo of {_count(self.echo_count, 'request')} came back",
               "the adapter and the cable to it work: check the device's power, its wires, "
               "device_id, baud rate and parity")
        yield (self.stray_byte_count,
               f"{_count(self.stray_byte_count, 'byte')} came that are no Modbus frame",
               "check baud rate, parity and stop bits, and that the device speaks Modbus RTU"
               if self.is_serial else "is this the port of a Modbus TCP server?")

    @property
    def _is_more_than_echo(self) -> bool:
        return bool(self.stray_byte_count or self.other_ids or self.damaged_frame_count
                    or self.late_answer_count or self.unexpected_answer_count)


def _count(number: int, what: str) -> str:
    return f"1 {what}" if number == 1 else f"{number} {what}s"
