"""A stream of lines: which are queued, which may be sent now, and what stops it.

A stream consists of the lines submitted from one reset to the next. Its counts remain after its end
until the next line submitted begins another stream at zero.
"""

from __future__ import annotations

import asyncio
import re
from collections import deque
from collections.abc import Callable, Iterable

from firmware_protocol.host import LocalProtocolError
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from lmctl.machine.motion.connection import GrblConnection
from lmctl.machine.motion.identity import ControllerIdentity
from lmctl.machine.motion.progress import StreamProgress
from lmctl.machine.motion.reply_audit import ReplyAudit

_MISSING_ANSWER_S = 5.0

# An AVR board stores these with interrupts off, and what arrives meanwhile is lost.
_STORES = re.compile(rb"G\s*0*(?:10|28\.10*|30\.10*)(?![0-9.])")


class LineStream:
    """Feeds lines to a connection as the controller has room.

    rejected(tag, error) : called at the first line answered with an error
    held : nothing more is sent while set
    halted : nothing more is sent until `end`
    """

    def __init__(self, connection: GrblConnection, rejected: Callable[[int, int], None]) -> None:
        self.progress = StreamProgress(planner_blocks=0, lead_s=0.0)
        self.running = False
        self.held = False
        self.halted = False
        self._connection = connection
        self._rejected = rejected
        self._queue: deque[bytes] = deque()
        self._loop = asyncio.get_running_loop()
        self._audit = ReplyAudit(connection)
        self._identity: ControllerIdentity | None = None
        self._owing_since_s: float | None = None  # since when Idle with an answer due

    @property
    def lines_queued(self) -> int:
        """Lines submitted and not sent."""
        return len(self._queue)

    def submit(self, lines: Iterable[bytes], identity: ControllerIdentity) -> None:
        """Queue lines and send what fits. Raises LocalProtocolError for an impossible line."""
        lines = list(lines)
        self._connection.check_lines(lines)
        text = b"\n".join(lines).upper()
        if b"$" in text or _STORES.search(text):
            for line in lines:
                if _STORES.search(line.upper()) or line.lstrip()[:1] == b"$":
                    raise LocalProtocolError(f"{line!r} stores something, so it must be sent alone")
        if not self.running:
            self._identity = identity
            lead_s = identity.dialect.segment_buffer_s
            self.progress = StreamProgress(identity.planner_blocks, lead_s)
            self.running = True
        self._queue.extend(lines)
        self.send_available()

    def send_available(self) -> None:
        """Send the lines there is room for, in one write."""
        if self.halted or self.held or not self._queue or not self._connection.may_write:
            return
        if self._audit.in_doubt:
            return
        self.progress.count_sent(self._connection.send_queued(self._queue, self.progress.sent))

    def discard_queue(self) -> int:
        """Drop the lines not sent; returns how many."""
        dropped = len(self._queue)
        self._queue.clear()
        return dropped

    def on_restart(self, *, halted: bool) -> None:
        """The controller restarted: nothing sent before will be answered or executed."""
        self._queue.clear()
        self.running = False
        self.held = False
        self.halted = halted
        self._audit.reset()
        self._owing_since_s = None

    def on_ok(self, count: int) -> None:
        """Take so many `ok`s in a row."""
        self._owing_since_s = None
        self.progress.count_ok(count, dwells_end=not self.held)

    def on_rejected(self, tag: int, error: int) -> None:
        """Take another answer; at the first one, hold.

        The lines behind the rejected one are on the controller already. Grbl runs on with them,
        grblHAL rejects each: neither is to be reported, and neither is to move the machine.
        """
        self._owing_since_s = None
        if self.progress.count_rejected() and not self.halted:  # not by an alarm before it
            self.halted = True
            self._connection.send_realtime(RealtimeCommand.HOLD)
            self._rejected(tag, error)

    def on_surplus_reply(self) -> None:
        """An answer came with no line due: an earlier answer came twice and credited a line.

        The host cannot determine which one, nor what was acknowledged and executed.
        """
        if self.running and not self.halted:
            self._lose_link(
                "a reply came to no command: the line doubles or invents bytes, and what "
                "was executed cannot be known"
            )

    def on_status_report(self, report: StatusReport) -> bool:
        """Take a report in its place among the answers; True if more lines count as executed."""
        grown = self.progress.on_status_report(report, self._loop.time())
        if not self.halted and self._identity is not None:
            wrong = self._audit.on_status_report(report, self.progress, self._identity)
            if wrong is not None:
                self._lose_link(f"{wrong}; what was executed cannot be known")
        self._look_for_lost_answer(report)
        return grown

    def _lose_link(self, reason: str) -> None:
        """Hold the machine and give it up: the acknowledged count is no longer known."""
        self.halted = True
        self._connection.send_realtime(RealtimeCommand.HOLD)
        self._connection.declare_lost(reason)

    def _look_for_lost_answer(self, report: StatusReport) -> None:
        """A controller idle for seconds that owes answers lost a line, or we lost an answer."""
        line = self.progress.oldest_unanswered_line()
        now_s = self._loop.time()
        if report.state != "Idle" or line is None or b"G4" in line:  # idle is how Grbl dwells
            self._owing_since_s = None
        elif self._owing_since_s is None:
            self._owing_since_s = now_s
        elif now_s - self._owing_since_s >= _MISSING_ANSWER_S:
            self._connection.declare_lost(
                f"the controller is idle, but {self.progress.lines_unanswered} lines "
                "are unanswered: bytes were lost on the line"
            )
