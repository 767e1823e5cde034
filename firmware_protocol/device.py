"""Device end of a Grbl link: bytes in, lines and real-time bytes out. Owns no port or clock.

Modelled on both firmwares' serial interrupt: real-time bytes are picked out of the stream as they
arrive; everything else waits in the receive buffer until the main loop reads it; bytes that find
the buffer full are lost. A loop with nothing to do reads bytes as they come, so an idle
controller takes a line longer than its buffer; a busy one does not.
"""

from __future__ import annotations

from collections import deque

from firmware_protocol.dialect import Dialect
from firmware_protocol.gcode import strip_comments_and_spaces
from firmware_protocol.messages import Message, WelcomeBanner
from firmware_protocol.realtime import RealtimeCommand

_MAX_RAW_BYTES = 4096  # kept of one line, comments included; a longer one is called too long
_ALL = frozenset(range(256))


class GrblDevice:
    """The receive buffer of a controller.

    rx_bytes : stated size of the buffer; one byte less is usable; the dialect's by default
    overruns : bytes lost so far because the buffer was full
    """

    def __init__(self, dialect: Dialect, rx_bytes: int | None = None) -> None:
        self.dialect = dialect
        self.rx_bytes = dialect.rx_bytes if rx_bytes is None else rx_bytes
        self.overruns = 0
        self._usable = self.rx_bytes - 1
        picked = frozenset(map(int, dialect.realtime_bytes))
        self._not_text = bytes(sorted(picked | dialect.ignored_bytes))
        self._not_realtime = bytes(sorted(_ALL - picked))
        self._lines: deque[bytes] = deque()
        self._partial = b""  # the start of a line whose end has not come
        self._used = 0  # bytes in the receive buffer
        self._head_read = 0  # bytes of the first line that have already left the buffer
        self._reading = True  # the main loop is waiting for bytes

    @property
    def free_rx_bytes(self) -> int:
        """Free bytes of the buffer as `Bf:` shows them."""
        return max(0, self.rx_bytes - self.dialect.rx_report_margin - self._used)

    @property
    def buffered_lines(self) -> int:
        """Whole lines in the buffer."""
        return len(self._lines)

    def receive_data(self, data: bytes) -> bytes:
        """Take bytes off the wire; return the real-time bytes among them, in order.

        A reset byte empties the buffer of everything before it. `pop_line` takes whole lines.
        """
        text = data.translate(None, self._not_text)
        if len(text) == len(data):
            self._buffer(text)
            return b""
        realtime = data.translate(None, self._not_realtime)
        reset_at = data.rfind(RealtimeCommand.RESET)
        if reset_at >= 0:
            self.clear_rx_buffer()
            text = data[reset_at + 1 :].translate(None, self._not_text)
        if text:
            self._buffer(text)
        return realtime

    def pop_line(self) -> bytes | None:
        """The oldest whole line without its end, whose bytes leave the buffer now; else None.

        A call that finds no line marks the controller as idle: it then reads bytes as they come.
        """
        if not self._lines:
            self._reading = True
            self._head_read = len(self._partial)
            self._used = 0
            return None
        line = self._lines.popleft()
        left = len(line) + 1 - self._head_read
        if left > 0:
            self._used -= left
        self._head_read = 0
        return line

    def is_line_too_long(self, line: bytes) -> bool:
        """Whether the firmware answers it with error:11; it stores no spaces and comments."""
        chars = self.dialect.max_line_chars
        if len(line) <= chars:
            return False
        return len(line) > _MAX_RAW_BYTES or len(strip_comments_and_spaces(line)) > chars

    def clear_rx_buffer(self) -> None:
        """Forget everything received and not yet taken, as a reset or a jog cancel does."""
        self._lines.clear()
        self._partial = b""
        self._used = 0
        self._head_read = 0
        self._reading = True

    def encode_message(self, message: Message) -> bytes:
        """The bytes of a message; a banner is preceded by an empty line, as both firmwares do."""
        text = message.format()
        return (f"\r\n{text}\r\n" if isinstance(message, WelcomeBanner) else f"{text}\r\n").encode(
            "latin-1"
        )

    def _buffer(self, text: bytes) -> None:
        if b"\r" in text:
            text = text.replace(b"\r", b"\n")
        if self._reading:
            read = text.find(b"\n") + 1 or len(text)  # up to the next line end
            self._reading = read == len(text) and not text.endswith(b"\n")
            self._head_read += read
        else:
            read = 0
        room = self._usable - self._used + read
        if len(text) > room:
            self.overruns += len(text) - room
            text = text[:room]
        self._used += len(text) - read
        *lines, self._partial = (self._partial + text).split(b"\n")
        self._lines.extend(lines)
        if len(self._partial) > _MAX_RAW_BYTES:
            self._partial = self._partial[: _MAX_RAW_BYTES + 1]
