"""What a host sees on a motion link while no status report comes, and what that points to.

A dead cable, a wrong baud rate, an echo and another device all look the same to a host waiting for
a report. The bytes that come instead distinguish them.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.realtime import RealtimeCommand

#: Bytes kept as an example.
_SAMPLE_BYTES = 60
#: Least share of non-text bytes that points to a wrong baud rate; one damaged byte in a hundred is
#: noise on a good line.
_GARBAGE = 0.2

_TEXT = frozenset(b"\r\n\t") | frozenset(range(32, 127))


@dataclass
class ControllerObservation:
    """Counts since the link was opened. is_serial, baud : of the link

    query_count : `?` sent; received : bytes
    non_text_byte_count : received bytes that are no printable ASCII, line end or tab
    echo_count : those that are `?`, which is all that has been sent
    message_count : whole messages of the firmware; restarts : those of them that are its banner
    """

    is_serial: bool
    baud: int
    query_count: int = 0
    received_byte_count: int = 0
    non_text_byte_count: int = 0
    echo_count: int = 0
    message_count: int = 0
    restart_count: int = 0
    sample: bytes = b""

    def on_data(self, data: bytes) -> None:
        """Bytes have arrived."""
        if len(self.sample) < _SAMPLE_BYTES:
            self.sample += data[:_SAMPLE_BYTES - len(self.sample)]
        self.received_byte_count += len(data)
        self.non_text_byte_count += sum(byte not in _TEXT for byte in data)
        self.echo_count += data.count(RealtimeCommand.STATUS.encoded)

    def diagnose_missing_report(self) -> tuple[str, str]:
        """What it means that no report came, in words, and what to do about it."""
        if not self.received_byte_count:
            return ("the motion controller is silent: no byte came back, and ? was sent "
                    f"{self.query_count} times", self._nothing_came())
        if self.echo_count == self.received_byte_count:
            return ("no motion controller answers: only the echo of what was sent (?) came back",
                    "look for a bridge between TX and RX, a loop-back plug, or an adapter that "
                    "echoes")
        if self.restart_count > 1:
            return (
                f"the motion controller restarted {self.restart_count} times, and sent no status "
                    "report", "check its power supply and its reset line")
        if self.non_text_byte_count >= _GARBAGE * self.received_byte_count:
            return ("what answers is not a Grbl controller, or speaks at another baud rate: "
                    f"{self.received_byte_count} bytes came, {self.non_text_byte_count} of them no "
                    f"text, such as {self._hex()}",
                    f"set motion.baud in the machine profile to the controller's ({self.baud} was "
                    "tried; 115200 is usual); at the right one, look at cable and grounding"
                    if self.is_serial else
                    "compare motion.endpoint in the machine profile with the controller's port, "
                    "and a serial server's baud rate with the controller's")
        if self.message_count:
            return (f"the motion controller sends messages, and no status report: "
                    f"{self._text()} came",
                    "what sends them may be another version of the firmware: Grbl 1.1 and grblHAL "
                    "answer ? with <...>")
        return (f"what answers is not a Grbl controller: {self._text()} came",
                "compare motion.endpoint and motion.baud in the machine profile with the "
                "controller: something else is at that port")

    def _nothing_came(self) -> str:
        if self.is_serial:
            return ("check that it has power, that this is its port, its cable (TX and RX may be "
                    f"swapped), and motion.baud: a controller at another rate than {self.baud} "
                    "does not understand the question (`lmctl machine doctor --search` tries the "
                    "usual ones)")
        return ("it takes the connection: check that this is the controller's port, and that no "
                "other program is connected, since most serve one at a time")

    def _hex(self) -> str:
        return self.sample[:8].hex(" ")

    def _text(self) -> str:
        return repr(self.sample.decode("ascii", "replace").strip())
