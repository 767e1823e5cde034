"""A conversation with a Grbl controller: link, codec and status questions put together.

Lower half of the motion driver. It knows lines, answers, reports and resets; streams, holds and
positions are above it. Events are handed on in the order they stood in the byte stream; those who
wait for one of them are in `awaited`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from firmware_protocol.codes import alarm_meaning, error_meaning
from firmware_protocol.dialect import GRBL, GRBLHAL, Dialect
from firmware_protocol.host import (
    Event,
    GrblHost,
    LocalProtocolError,
    Rejected,
    RemoteProtocolError,
    Restarted,
)
from firmware_protocol.messages import Alarm, Status, Unknown
from firmware_protocol.realtime import Realtime
from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError
from lmctl.machine.motion.awaited import Awaited
from lmctl.machine.motion.endpoint import parse_endpoint
from lmctl.machine.motion.hearer import Hearer
from lmctl.machine.motion.links import Link, open_link
from lmctl.machine.motion.observation import ControllerObservation
from lmctl.machine.motion.report_screen import ReportScreen
from lmctl.machine.motion.status_watch import StatusWatch

_COMMAND_TAG = -1
_LOST_HINT = "check cable and power of the controller, and that no other program talks to it"
_RESET_TAKES_S = 0.3  # to the banner, where the controller has power
_LEAST_RX_USABLE = 127  # before the controller has said how much it has


class Conversation:
    """One open link to a controller.

    dialect : Grbl's until `settle_on` is told better
    damaged : messages so far that were no message or answered nothing
    lost, is_silent : why nothing more will come, and whether because nothing did
    observation : what arrives, from connecting to the first report; None otherwise
    rx_empty : most free receive bytes reported with nothing unanswered
    screen : which reports are believed
    sent_before_question : tag of the newest line unanswered when `?` was sent, or None
    """

    def __init__(self, endpoint: str, status_period_s: float, hearer: Hearer) -> None:
        self.endpoint = endpoint
        self.dialect: Dialect = GRBL
        self.damaged = 0
        self.observation: ControllerObservation | None = None
        self.lost: str | None = None
        self.is_silent = False
        self.rx_empty = 0
        self.sent_before_question: int | None = None
        self.watch = StatusWatch(status_period_s, self._ask, self._fell_silent)
        self.screen = ReportScreen()
        self._hearer = hearer
        self._loop = asyncio.get_running_loop()
        self._host = GrblHost(_LEAST_RX_USABLE, GRBL.line_chars)
        self._link: Link | None = None
        self._awaited = Awaited(self.error)
        self._reset_sent_s: float | None = None  # the first whose banner has not come
        self._silent_at_reset = False
        self._with_question: bytes | None = None  # lines to be sent in one write with a `?`

    async def connect(self, baud: int, timeout_s: float) -> None:
        """Open the link. Raises MachineError, ConfigError."""
        is_serial = parse_endpoint(self.endpoint).kind == "serial"
        self.observation = ControllerObservation(is_serial, baud)
        self._link = await open_link(
            self.endpoint, baud, self._received, self.give_up, timeout_s
        )

    def close(self) -> None:
        """Stop asking and close the link; whoever still waits gets MachineError."""
        self.watch.stop()
        if self._link is not None:
            self._link.close()
        self._awaited.lost(self.error("the link was closed"))

    def settle_on(self, dialect: Dialect, rx_bytes: int) -> None:
        """Use what the controller has said of itself. Nothing may be unanswered."""
        self.dialect = dialect
        self._host = GrblHost(rx_bytes - 1, dialect.line_chars)

    @property
    def unanswered(self) -> int:
        """Lines sent and not answered, commands included."""
        return self._host.unanswered

    @property
    def commanding(self) -> bool:
        """Whether a command is unanswered."""
        return self._awaited.command is not None or self._host.oldest_tag == _COMMAND_TAG

    @property
    def all_sent(self) -> bool:
        """Whether nothing is held back here that is counted as sent."""
        return self._link is not None and not self._link.unsent

    @property
    def worth_a_write(self) -> bool:
        """Whether so much room is free, or so little under way, that lines should go out now.

        A wire without a pace is spared a write for every answer. Half full, and with the planner
        behind it, the buffer does not run dry, and a dry run of short lines takes a quarter less
        time.
        """
        host = self._host
        return (
            host.free >= host.rx_usable // 2
            or host.unanswered == 0
            or (self._link is not None and self._link.paced)
        )

    def check_lines(self, lines: Sequence[bytes]) -> None:
        """Raise LocalProtocolError if one of the lines could never be sent."""
        self._host.check_lines(lines)

    def send_waiting(self, waiting: deque[bytes], tag: int) -> list[bytes]:
        """Send the checked lines there is room for, in one write, and take them off `waiting`.

        tag : of the first; those behind it count on
        """
        sent = self._host.send_waiting(waiting, tag)
        if sent:
            self.write(b"\n".join(sent) + b"\n")
        return sent

    def write(self, data: bytes) -> None:
        """Send after all that went before; while a question is being put, together with it."""
        if self._with_question is not None:
            self._with_question += data
        elif self._link is not None:
            self._link.write(data)

    def realtime(self, byte: Realtime) -> None:
        """Send one byte before everything not yet on the wire. A reset drops all that waits."""
        if self._link is None:
            return
        if byte is Realtime.RESET:
            if self._reset_sent_s is None:
                self._reset_sent_s = self._loop.time()
                self._silent_at_reset = self.watch.unanswered_s > _RESET_TAKES_S
            self._link.discard_unsent()
        self.screen.commanded(byte)
        self._link.write_realtime(byte.wire)

    async def command(self, line: str, timeout_s: float) -> list[str]:
        """Send one line alone; return what was said before its `ok`.

        raises : MachineError on error, alarm, restart, loss or no answer in time;
            LocalProtocolError while other lines are unanswered
        """
        self._refuse_if_lost()
        if self._awaited.command is not None or self._host.unanswered:
            raise LocalProtocolError(f"{line!r} must be sent alone, and lines are unanswered")
        data = self._host.send_line(line.encode("ascii", "replace"), _COMMAND_TAG)
        return await self._awaited.answer(line, lambda: self.write(data), timeout_s)

    async def fresh_report(self, timeout_s: float) -> StatusReport | None:
        """Ask `?` and wait for the next report; None if none comes in time."""
        self._refuse_if_lost()
        report = await self._awaited.report(self.watch.ask_now, timeout_s)
        if report is None:
            self.watch.abandon_question()
        return report

    async def reset(self, timeout_s: float) -> None:
        """Send 0x18 and wait for the banner. Raises MachineError if none comes in time."""
        self._refuse_if_lost()
        await self._awaited.restart(lambda: self.realtime(Realtime.RESET), timeout_s)

    def _ask(self) -> None:
        if self.observation is not None:
            self.observation.questions += 1
        if self.watch.is_repeated:
            self.screen.missed()
        else:
            self.sent_before_question = self._host.newest_tag
        self._with_question = b""
        try:
            self._hearer.asking()
        finally:
            lines, self._with_question = self._with_question, None
        question = Realtime.STATUS
        if self.screen.is_unsure and self.dialect is GRBLHAL:
            question = Realtime.STATUS_FULL  # with offset and overrides, which few reports carry
        if lines and self._link is not None and not (self._link.paced or self._link.unsent):
            self._link.write(lines + question.wire)
        else:
            self.write(lines)
            self.realtime(question)

    def _received(self, data: bytes) -> None:
        if self.observation is not None:
            self.observation.add(data)
        accepted = 0
        for event in self._host.receive_data(data):
            if type(event) is int and event != _COMMAND_TAG:
                accepted += 1
                continue
            if accepted:
                self._hearer.accepted(accepted)
                accepted = 0
            self._hear(event)
        if accepted:
            self._hearer.accepted(accepted)
        self._hearer.batch_done()

    def _hear(self, event: Event) -> None:
        if self.observation is not None:
            self.observation.restarts += isinstance(event, Restarted)
            self.observation.messages += not isinstance(event, int | Unknown | RemoteProtocolError)
        if isinstance(event, int):
            self._command_answered(0)
        elif isinstance(event, Rejected):
            if event.tag == _COMMAND_TAG:
                self._command_answered(event.code)
            else:
                self._hearer.rejected(event.tag, event.code)
        elif isinstance(event, Status):
            self._reported(event.report)
        elif isinstance(event, Restarted):
            self._restarted()
        elif isinstance(event, Alarm):
            meaning = alarm_meaning(event.code, self.dialect)
            self._awaited.refused(f"alarm {event.code}: {meaning.words}", meaning.remedy)
            self._hearer.alarm(event.code)
        elif isinstance(event, RemoteProtocolError):
            self.damaged += 1
            self._hearer.surplus_answer()
        elif isinstance(event, Unknown):
            self.damaged += 1
            if self.watch.is_open:  # most of what a controller says while asked is the answer
                self.screen.missed()
                self.watch.ask_again()
        elif self._awaited.command is not None:
            self._awaited.said(event.format())

    def _reported(self, said: StatusReport) -> None:
        report = self.screen.take(said, self._loop.time())
        if report is None:
            self.watch.ask_again()
            return
        self.watch.answered()
        if not self._host.unanswered:
            self.rx_empty = max(self.rx_empty, report.rx_free or 0)
        self._hearer.report(report)
        if self._awaited.reports:
            self._awaited.reported(report)
        if self.screen.is_unsure:
            self.watch.ask_soon()

    def _command_answered(self, code: int) -> None:
        if code:
            meaning = error_meaning(code, self.dialect)
            self._awaited.refused(f"error {code}: {meaning.words}", meaning.remedy)
        else:
            self._awaited.accepted()

    def _restarted(self) -> None:
        asked = self._is_reset_answered()
        self._reset_sent_s = None
        self._awaited.refused("the controller restarted", "send it again")
        self.screen.restarted()
        self._hearer.restarted(asked)
        self._awaited.restarted()
        self.watch.restarted()

    def _is_reset_answered(self) -> bool:
        """Whether a banner answers a reset that was sent here.

        One that comes late, from a controller that had been silent, is that of a start: the reset
        went to a controller without power.
        """
        if self._reset_sent_s is None:
            return False
        return not self._silent_at_reset or (
            self._loop.time() - self._reset_sent_s <= _RESET_TAKES_S
        )

    def _fell_silent(self, reason: str) -> None:
        self.is_silent = True
        self.give_up(reason)

    def give_up(self, reason: str) -> None:
        """Count the controller as lost; told once."""
        if self.lost is not None:
            return
        self.lost = reason
        self.watch.stop()
        self._awaited.lost(self.error(reason, hint=_LOST_HINT))
        self._hearer.lost(reason)

    def _refuse_if_lost(self) -> None:
        if self.lost is not None:
            raise self.error(self.lost, hint=_LOST_HINT)

    def error(self, what: str, hint: str = "") -> MachineError:
        """A MachineError about this controller."""
        return MachineError(what, where=f"motion controller at {self.endpoint}", hint=hint)
