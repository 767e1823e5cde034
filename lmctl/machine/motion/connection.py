"""A connection to a Grbl controller: link, codec and status queries combined.

Lower half of the motion driver: lines, replies, reports and resets. Streams, holds and positions
are above it. Callbacks are called in the order of the byte stream.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from firmware_protocol.codes import alarm_meaning, error_meaning
from firmware_protocol.dialect import GRBL, GRBLHAL, Dialect
from firmware_protocol.host import (
    ControllerRestarted,
    GrblHost,
    HostEvent,
    LineRejected,
    LocalProtocolError,
    RemoteProtocolError,
)
from firmware_protocol.messages import AlarmMessage, StatusMessage, UnknownMessage
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.callbacks import ConnectionCallbacks
from lmctl.machine.motion.endpoint import parse_motion_endpoint
from lmctl.machine.motion.links import ByteLink, open_link
from lmctl.machine.motion.observation import ControllerObservation
from lmctl.machine.motion.pending_replies import PendingReplies
from lmctl.machine.motion.resets import ResetTracker
from lmctl.machine.motion.status_polling import StatusPolling
from lmctl.machine.motion.status_report_filter import StatusReportFilter

_COMMAND_TAG = -1
_LOST_HINT = "check cable and power of the controller, and that no other program uses it"
_MIN_RX_USABLE = 127  # until the controller has reported its size


class GrblConnection:
    """One open link to a controller.

    dialect : Grbl's until `use_dialect` sets another
    damaged : messages so far that were unreadable or replied to nothing
    lost, is_silent : why the link is lost, and whether because the controller was silent
    observation : what arrives, from connecting to the first report; None otherwise
    rx_empty : most free receive bytes reported with nothing unanswered
    screen : which reports are believed
    sent_before_question : tag of the newest line unanswered when `?` was sent, or None
    """

    def __init__(
        self, endpoint: str, status_period_s: float, callbacks: ConnectionCallbacks) -> None:
        self.endpoint = endpoint
        self.dialect: Dialect = GRBL
        self.damaged = 0
        self.observation: ControllerObservation | None = None
        self.lost: str | None = None
        self.is_silent = False
        self.rx_empty = 0
        self.sent_before_question: int | None = None
        self.watch = StatusPolling(status_period_s, self._ask, self._fell_silent)
        self.screen = StatusReportFilter()
        self._callbacks = callbacks
        self._loop = asyncio.get_running_loop()
        self._host = GrblHost(_MIN_RX_USABLE, GRBL.max_line_chars)
        self._link: ByteLink | None = None
        self._awaited = PendingReplies(self.device_error)
        self._resets = ResetTracker()
        self._with_question: bytes | None = None  # lines to be sent in one write with a `?`

    async def open(self, baud: int, timeout_s: float) -> None:
        """Open the link. Raises MachineError, ConfigError."""
        is_serial = parse_motion_endpoint(self.endpoint).kind == "serial"
        self.observation = ControllerObservation(is_serial, baud)
        self._link = await open_link(
            self.endpoint, baud, self._received, self.declare_lost, timeout_s
        )

    def close(self) -> None:
        """Stop polling and close the link; every pending reply ends with MachineError."""
        self.watch.stop()
        if self._link is not None:
            self._link.close()
        self._awaited.on_lost(self.device_error("the link was closed"))

    def use_dialect(self, dialect: Dialect, rx_bytes: int) -> None:
        """Use what the controller has reported about itself, with nothing unanswered."""
        self.dialect = dialect
        self._host = GrblHost(rx_bytes - 1, dialect.max_line_chars)

    @property
    def unanswered_lines(self) -> int:
        """Lines sent and not answered, commands included."""
        return self._host.unanswered_lines

    @property
    def is_command_pending(self) -> bool:
        """Whether a command is unanswered."""
        return self._awaited.command is not None or self._host.oldest_unanswered_tag == _COMMAND_TAG

    @property
    def is_all_sent(self) -> bool:
        """Whether nothing is held back here that is counted as sent."""
        return self._link is not None and not self._link.unsent_bytes

    @property
    def may_write(self) -> bool:
        """Whether enough room is free, or little enough under way, that lines should go out now.

        An unpaced link then needs no write for every answer. Half full, and with the planner
        behind it, the buffer does not run dry, and a dry run of short lines takes a quarter less
        time.
        """
        host = self._host
        return (
            host.free_rx_bytes >= host.rx_usable // 2
            or host.unanswered_lines == 0
            or (self._link is not None and self._link.is_paced)
        )

    def check_lines(self, lines: Sequence[bytes]) -> None:
        """Raise LocalProtocolError if one of the lines could never be sent."""
        self._host.check_lines(lines)

    def send_queued(self, waiting: deque[bytes], tag: int) -> list[bytes]:
        """Send the checked lines there is room for, in one write, and take them off `waiting`.

        tag : of the first; those behind it count on
        """
        sent = self._host.send_queued(waiting, tag)
        if sent:
            self.write(b"\n".join(sent) + b"\n")
        return sent

    def write(self, data: bytes) -> None:
        """Send after all that went before; while a question is being put, together with it."""
        if self._with_question is not None:
            self._with_question += data
        elif self._link is not None:
            self._link.write(data)

    def send_realtime(self, byte: RealtimeCommand) -> None:
        """Send one byte before everything not yet on the wire. A reset drops all that waits."""
        if self._link is None:
            return
        if byte is RealtimeCommand.RESET:
            self._resets.on_reset_sent(self._loop.time(), self.watch.unanswered_s)
            self._link.discard_unsent()
        self.screen.on_realtime_sent(byte)
        self._link.write_realtime(byte.encoded)

    async def send_command(self, line: str, timeout_s: float) -> list[str]:
        """Send one line alone; return the messages received before its `ok`.

        raises : MachineError on error, alarm, restart, loss or no answer in time;
            LocalProtocolError while other lines are unanswered
        """
        self._refuse_if_lost()
        if self._awaited.command is not None or self._host.unanswered_lines:
            raise LocalProtocolError(f"{line!r} must be sent alone, and lines are unanswered")
        data = self._host.send_line(line.encode("ascii", "replace"), _COMMAND_TAG)
        return await self._awaited.command_reply(line, lambda: self.write(data), timeout_s)

    async def query_report(self, timeout_s: float) -> StatusReport | None:
        """Ask `?` and wait for the next report; None if none comes in time."""
        self._refuse_if_lost()
        report = await self._awaited.next_report(self.watch.query_now, timeout_s)
        if report is None:
            self.watch.abandon_query()
        return report

    async def reset(self, timeout_s: float) -> None:
        """Send 0x18 and wait for the banner. Raises MachineError if none comes in time."""
        self._refuse_if_lost()
        await self._awaited.wait_for_restart(lambda: self.send_realtime(RealtimeCommand.RESET),
                                             timeout_s)

    def _ask(self) -> None:
        if self.observation is not None:
            self.observation.query_count += 1
        if self.watch.is_query_repeated:
            self.screen.on_missed_report()
        else:
            self.sent_before_question = self._host.newest_unanswered_tag
        self._with_question = b""
        try:
            self._callbacks.on_query()
        finally:
            lines, self._with_question = self._with_question, None
        question = RealtimeCommand.STATUS
        if self.screen.is_unsure and self.dialect is GRBLHAL:
            # with offset and overrides, which few reports carry
            question = RealtimeCommand.STATUS_FULL
        if lines and self._link is not None and not (
            self._link.is_paced or self._link.unsent_bytes):
            self._link.write(lines + question.encoded)
        else:
            self.write(lines)
            self.send_realtime(question)

    def _received(self, data: bytes) -> None:
        if self.observation is not None:
            self.observation.on_data(data)
        accepted = 0
        for event in self._host.receive_data(data):
            if type(event) is int and event != _COMMAND_TAG:
                accepted += 1
                continue
            if accepted:
                self._callbacks.on_ok(accepted)
                accepted = 0
            self._on_event(event)
        if accepted:
            self._callbacks.on_ok(accepted)
        self._callbacks.on_batch_done()

    def _on_event(self, event: HostEvent) -> None:
        if self.observation is not None:
            self.observation.restart_count += isinstance(event, ControllerRestarted)
            self.observation.message_count += not isinstance(
                event, int | UnknownMessage | RemoteProtocolError)
        if isinstance(event, int):
            self._command_answered(0)
        elif isinstance(event, LineRejected):
            if event.tag == _COMMAND_TAG:
                self._command_answered(event.code)
            else:
                self._callbacks.on_rejected(event.tag, event.code)
        elif isinstance(event, StatusMessage):
            self._reported(event.report)
        elif isinstance(event, ControllerRestarted):
            self._restarted()
        elif isinstance(event, AlarmMessage):
            meaning = alarm_meaning(event.code, self.dialect)
            self._awaited.on_refused(f"alarm {event.code}: {meaning.description}", meaning.remedy)
            self._callbacks.on_alarm(event.code)
        elif isinstance(event, RemoteProtocolError):
            self.damaged += 1
            self._callbacks.on_surplus_reply()
        elif isinstance(event, UnknownMessage):
            self.damaged += 1
            if self.watch.is_query_open:  # while a query is open, most messages are its answer
                self.screen.on_missed_report()
                self.watch.on_unreadable_report()
        elif self._awaited.command is not None:
            self._awaited.on_message(event.format())

    def _reported(self, said: StatusReport) -> None:
        self._resets.on_report()
        report = self.screen.believed_report(said, self._loop.time())
        if report is None:
            self.watch.on_unreadable_report()
            return
        self.watch.on_report()
        if not self._host.unanswered_lines:
            self.rx_empty = max(self.rx_empty, report.rx_bytes_free or 0)
        self._callbacks.on_report(report)
        if self._awaited.reports:
            self._awaited.on_report(report)
        if self.screen.is_unsure:
            self.watch.query_next_tick()

    def _command_answered(self, code: int) -> None:
        if code:
            meaning = error_meaning(code, self.dialect)
            how = "arrived damaged" if meaning.implies_damaged_line else "was refused"
            self._awaited.on_refused(f"error {code}: {meaning.description}", meaning.remedy, how)
        else:
            self._awaited.on_ok()

    def _restarted(self) -> None:
        asked = self._resets.banner_answers_reset(self._loop.time())
        self._awaited.on_refused("the controller restarted", "send it again")
        self.screen.on_restart()
        self._callbacks.on_restart(asked)
        self._awaited.on_restart()
        self.watch.on_restart()

    def _fell_silent(self, reason: str) -> None:
        self.is_silent = True
        self.declare_lost(reason)

    def declare_lost(self, reason: str) -> None:
        """Count the controller as lost; reported once."""
        if self.lost is not None:
            return
        self.lost = reason
        self.watch.stop()
        self._awaited.on_lost(self.device_error(reason, hint=_LOST_HINT))
        self._callbacks.on_lost(reason)

    def _refuse_if_lost(self) -> None:
        if self.lost is not None:
            raise self.device_error(self.lost, hint=_LOST_HINT)

    def device_error(self, what: str, hint: str = "") -> MachineError:
        """A MachineError about this controller."""
        return MachineError(what, where=f"motion controller at {self.endpoint}", hint=hint)
