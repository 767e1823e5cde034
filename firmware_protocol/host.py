"""Host end of a Grbl link: bytes in, events out; lines in, bytes out. Owns no port, clock or task.

Flow control is character counting (Grbl `doc/markdown/interface.md`): the bytes of all lines sent
and not yet answered, line ends included, never exceed the controller's receive buffer. Every `ok`
or `error:N` frees the oldest line. Real-time bytes are not lines and are not counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from firmware_protocol.messages import (
    AlarmMessage,
    ErrorReply,
    FeedbackMessage,
    OkReply,
    SettingMessage,
    StartupBlockReply,
    StartupBlockSetting,
    StatusMessage,
    UnknownMessage,
    WelcomeBanner,
    parse_message,
)
from firmware_protocol.realtime import RealtimeCommand

MAX_LINE_BYTES = 1024
"""Longest received line taken as one; the rest of a longer one is Unknown."""

_FORBIDDEN = bytes((*range(0x20), *range(0x7E, 0x100), RealtimeCommand.HOLD,
                    RealtimeCommand.STATUS))
_FORBIDDEN_IN_TEXT = _FORBIDDEN.replace(b"\n", b"")


class LocalProtocolError(Exception):
    """The host tried to send what must not be sent: a bug on the host side."""


class LineRejected(NamedTuple):
    """The line sent with `tag` was answered `error:code`."""

    tag: int
    code: int


@dataclass(frozen=True, slots=True)
class RemoteProtocolError:
    """An invalid message from the controller, such as an answer to no line. It credits nothing."""

    text: str
    reason: str


@dataclass(frozen=True, slots=True)
class ControllerRestarted:
    """The controller sent its banner: the lines with these tags will never be answered."""

    banner: str
    unanswered_tags: tuple[int, ...]


# An int is the tag of a line that was answered `ok`: by far the most frequent event.
HostEvent = (
    int | LineRejected | RemoteProtocolError | ControllerRestarted | AlarmMessage | StatusMessage
    | FeedbackMessage | SettingMessage | StartupBlockSetting | StartupBlockReply | UnknownMessage
)


class GrblHost:
    """The host's side of one connection to a controller.

    rx_usable : bytes of the controller's receive buffer that may be filled
    line_chars : most characters of one line
    """

    def __init__(self, rx_usable: int, line_chars: int) -> None:
        self.rx_usable = rx_usable
        self._most_chars = min(line_chars, rx_usable - 1)
        self._free = rx_usable
        self._unanswered: deque[tuple[int, int]] = deque()  # (tag, size), oldest first
        self._partial = b""
        self._skipping = False  # inside a line that is too long to be valid

    @property
    def free_rx_bytes(self) -> int:
        """Bytes that may be sent now, line end included."""
        return self._free

    @property
    def unanswered_lines(self) -> int:
        """Lines sent and not answered."""
        return len(self._unanswered)

    @property
    def oldest_unanswered_tag(self) -> int | None:
        """Tag of the line whose answer is due next, or None."""
        return self._unanswered[0][0] if self._unanswered else None

    @property
    def newest_unanswered_tag(self) -> int | None:
        """Tag of the line sent last, where that is unanswered."""
        return self._unanswered[-1][0] if self._unanswered else None

    def can_send(self, line: bytes) -> bool:
        """Whether the controller has room for `line` (without its end) now."""
        return len(line) < self._free

    def check_line(self, line: bytes) -> None:
        """Raise LocalProtocolError for a line that could never be sent.

        It must be printable ASCII without its line end and without `! ? ~`, which would act, and
        no longer than the controller stores and receives.
        """
        if len(line) > self._most_chars:
            raise LocalProtocolError(
                f"a line has {len(line)} characters, the controller takes {self._most_chars}: "
                f"{line[:40]!r}..."
            )
        if line.translate(None, _FORBIDDEN) != line:
            raise LocalProtocolError(f"a line holds bytes that would act or break it: {line!r}")

    def check_lines(self, lines: Sequence[bytes]) -> None:
        """Raise LocalProtocolError if one of the lines could never be sent.

        They are checked as one text, and one by one only where that check fails.
        """
        text = b"\n".join(lines)
        if (
            max(map(len, lines), default=0) > self._most_chars
            or text.translate(None, _FORBIDDEN_IN_TEXT) != text
            or text.count(b"\n") >= max(1, len(lines))
        ):
            for line in lines:
                self.check_line(line)

    def send_line(self, line: bytes, tag: int) -> bytes:
        """The bytes of a line, counted until it is answered. Raises LocalProtocolError."""
        self.check_line(line)
        if not self.can_send(line):
            raise LocalProtocolError(
                f"line {tag} needs {len(line) + 1} bytes, {self._free} are free"
            )
        self._unanswered.append((tag, len(line) + 1))
        self._free -= len(line) + 1
        return line + b"\n"

    def send_queued(self, waiting: deque[bytes], tag: int) -> list[bytes]:
        """Take off the lines there is room for, counted as sent without their ends.

        waiting : lines that have passed `check_lines`, oldest first
        tag : of the first; those behind it count on
        """
        sent: list[bytes] = []
        free = self._free
        while waiting and len(waiting[0]) < free:
            line = waiting.popleft()
            size = len(line) + 1
            self._unanswered.append((tag, size))
            free -= size
            tag += 1
            sent.append(line)
        self._free = free
        return sent

    def abandon_unanswered(self) -> tuple[int, ...]:
        """Give up every unanswered line; returns their tags, oldest first."""
        lost = tuple(tag for tag, _ in self._unanswered)
        self._unanswered.clear()
        self._free = self.rx_usable
        return lost

    def receive_data(self, data: bytes) -> list[HostEvent]:
        """Take bytes off the wire; return what they complete, in order. Never raises.

        Lines end LF or CRLF; empty ones (a banner follows one) are no event.
        """
        events: list[HostEvent] = []
        *lines, self._partial = (self._partial + data).split(b"\n")
        for line in lines:
            if line == b"ok\r" and self._unanswered and not self._skipping:
                tag, size = self._unanswered.popleft()
                self._free += size
                events.append(tag)
            else:
                self._take(line, events)
        if len(self._partial) > MAX_LINE_BYTES:
            if not self._skipping:
                events.append(UnknownMessage(self._partial[:MAX_LINE_BYTES].decode("latin-1")))
            self._partial = b""
            self._skipping = True
        return events

    def _take(self, line: bytes, events: list[HostEvent]) -> None:
        if self._skipping:  # the end of a line that was already reported
            self._skipping = False
            return
        text = line[:-1] if line.endswith(b"\r") else line
        if not text:
            return
        if len(text) > MAX_LINE_BYTES:
            events.append(UnknownMessage(text[:MAX_LINE_BYTES].decode("latin-1")))
            return
        message = parse_message(text.decode("latin-1"))
        if isinstance(message, StatusMessage):
            events.append(message)
        elif isinstance(message, (OkReply, ErrorReply)):
            events.append(self._answer(message))
        elif isinstance(message, WelcomeBanner):
            events.append(ControllerRestarted(message.text, self.abandon_unanswered()))
        else:
            events.append(message)

    def _answer(self, message: OkReply | ErrorReply) -> int | LineRejected | RemoteProtocolError:
        if not self._unanswered:
            return RemoteProtocolError(message.format(), "it answers no line that was sent")
        tag, size = self._unanswered.popleft()
        self._free += size
        return LineRejected(tag, message.code) if isinstance(message, ErrorReply) else tag
