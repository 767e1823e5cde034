"""Check the buffer levels a controller reports against the answers received from it.

Answers carry no number: one that comes twice credits a line too early, one that is lost credits it
never, and both go on for as long as the stream does. A status report gives them away:

- `Bf:`, free receive bytes. Lines in the receive buffer are unanswered. And a controller that
  moves reads that buffer: both firmwares look at real-time requests with it drained, or with one
  line wholly taken out of it and not answered yet (`protocol.c`, `protocol_main_loop`). So while it
  holds bytes, those are of the unanswered lines but the oldest. Held or asleep it reads none.
- `Ln:`, the line at the planner's head, and `Bf:`, how many blocks are queued from there on. A line
  makes one block at most, so as many lines have been planned, and answered (grblHAL; stock Grbl
  reports no `Ln:`: there a missing answer shows when all is done).

One report proves nothing: bytes may arrive between reading and reporting, and a digit may be
damaged. It only casts doubt. Then nothing is sent, and the next reports, with nothing on its way to
the controller, confirm the doubt or clear it.
"""

from __future__ import annotations

from firmware_protocol.status import StatusReport
from lmctl.machine.motion.connection import GrblConnection
from lmctl.machine.motion.identity import ControllerIdentity
from lmctl.machine.motion.progress import StreamProgress

_READS_NO_LINES = ("Hold", "Door", "Sleep", "Tool")
_PROOFS = 3  # the first may have been on its way when the last bytes were


class ReplyAudit:
    """The audit of one connection to a controller.

    in_doubt : nothing may be sent until the next reports have decided
    """

    def __init__(self, connection: GrblConnection) -> None:
        self.in_doubt = False
        self._connection = connection
        self._proofs = 0
        self._quiet = False  # everything counted as sent had left when the report was asked for

    def reset(self) -> None:
        """The controller restarted: what it held is gone."""
        self.in_doubt = False

    def on_status_report(
        self, report: StatusReport, progress: StreamProgress, identity: ControllerIdentity
    ) -> str | None:
        """Take a report in its place among the answers; what is proven to be wrong, or None."""
        if self._connection.is_command_pending:
            return None
        rx_most = identity.rx_bytes - identity.dialect.rx_report_margin
        free = rx_most if report.rx_bytes_free is None else report.rx_bytes_free
        held = min(self._connection.rx_empty, rx_most) - free
        wrong = self._held_too_much(held, report, progress)
        wrong = wrong or _planned_too_much(report, progress)
        if not self.in_doubt:
            if wrong:
                self.in_doubt, self._proofs = True, 0
                self._ask_in_quiet()
        elif self._quiet and wrong:
            self._proofs += 1
            if self._proofs >= _PROOFS:
                return wrong
            self._ask_in_quiet()
        elif self._quiet and _sound(held, report, progress):
            self.in_doubt = False
        else:  # the next report comes in its time
            self._quiet = self._connection.is_all_sent
        return None

    def _ask_in_quiet(self) -> None:
        self._quiet = self._connection.is_all_sent
        self._connection.watch.query_now()

    def _held_too_much(self, held: int, report: StatusReport,
                       progress: StreamProgress) -> str | None:
        if held <= 0:
            return None
        # Not what the codec counts: that has taken the answers behind this report, too.
        oldest, most = progress.oldest_unanswered_line(), progress.unanswered_bytes()
        if report.state not in _READS_NO_LINES and oldest is not None:
            if not self.in_doubt and self._all_went_with_the_question(progress):
                return None
            most -= len(oldest) + 1
        if held <= most:
            return None
        return (
            f"an answer came twice: the controller still has {held} bytes of lines to read, by its "
            f"answers {max(0, most)} at most"
        )

    def _all_went_with_the_question(self, progress: StreamProgress) -> bool:
        before = self._connection.sent_before_question
        return before is None or progress.lines_answered > before


def _sound(held: int, report: StatusReport, progress: StreamProgress) -> bool:
    """Whether a report in quiet, with nothing wrong in it, clears the doubt.

    With the receive buffer drained, a line may be waiting for room in the planner, and its answer
    will be one too many.
    """
    if held > 0:
        return report.state not in _READS_NO_LINES
    return not progress.lines_unanswered and report.planner_blocks_free != 0


def _planned_too_much(report: StatusReport, progress: StreamProgress) -> str | None:
    if report.state != "Run" or report.line_number is None:
        return None
    missing = progress.min_planned_lines(report.line_number, report.planner_blocks_free)
    missing -= progress.lines_answered
    if missing <= 0:
        return None
    return f"an answer is missing: {missing} of the lines the controller has planned are unanswered"
