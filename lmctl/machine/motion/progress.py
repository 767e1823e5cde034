"""How far a stream of lines has come: sent, acknowledged, executed, each counted apart.

`ok` means planned, not done. What is done is read from status reports:

- `Ln:n`: the line with word `N n` is at the head of the planner, so those before it have left it.
- else `Bf:`: the planner still holds b blocks, so of the acknowledged lines that make a block all
  but the last b have left it; one more is held back, should a line have made no block.
- Idle, everything answered and the planner empty: all is done.

A dwell (G4) alone needs no report: both firmwares wait for the axes to come to rest before it, and
answer when it is over, so its `ok` confirms that it and all before it are done.

A block leaves the planner while up to `segment_buffer_s` of motion is still to be made. So a line
that has left the planner counts as executed that much later, at the next report. In a hold at
standstill it counts at once, since the segment buffer is then empty.

A digit of `Ln:` or `Bf:` may be damaged on the way, and a line once counted as executed stays so.
So only lines count that both reports show as done: a block that left the planner does not return.

Nothing is ever called executed before it is acknowledged, and nothing at or after a rejected line.
A line that makes no block (M4, G21) counts as executed once the motion before it does.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence
from itertools import islice

from firmware_protocol.status import StatusReport

_MOVING = ("Run", "Hold", "Door")
_DWELL = re.compile(rb"G0?4(?![0-9.])")


class StreamProgress:
    """Counts of one stream.

    planner_blocks : what `Bf:` shows when the planner is empty
    lead_s : most time a line that has left the planner still takes
    sent, acknowledged, executed : lines, in the order of the stream; acknowledged stops at the
        first rejected line
    """

    def __init__(self, planner_blocks: int, lead_s: float) -> None:
        self.sent = 0
        self.acknowledged = 0
        self.executed = 0
        self._planner_blocks = planner_blocks
        self._lead_s = lead_s
        self._answered = 0
        self._rejected: int | None = None  # index of the first rejected line
        self._open: deque[bytes] = deque()  # lines sent and not executed, from index `executed`
        self._dwells: deque[int] = deque()  # which of the lines not answered are dwells
        self._blockless: deque[int] = deque()  # which of the open lines make no block
        self._idle_answered = -1  # `_answered` at the last report if that was Idle
        self._left_planner: deque[tuple[float, int]] = deque()  # (when seen, lines), oldest first
        self._placed = (-1, -1)  # number and index of the line last looked for

    @property
    def first_rejected_line(self) -> int | None:
        """Index of the first rejected line, or None."""
        return self._rejected

    @property
    def lines_answered(self) -> int:
        """Lines answered, `ok` or not."""
        return self._answered

    @property
    def lines_unanswered(self) -> int:
        """Lines sent and not answered."""
        return self.sent - self._answered

    @property
    def is_all_executed(self) -> bool:
        """Whether every line sent is executed."""
        return self.executed == self.sent

    def count_sent(self, lines: Sequence[bytes]) -> None:
        """Count lines that are on their way."""
        for index, line in enumerate(lines, self.sent):
            if not makes_planner_block(line):
                self._blockless.append(index)
                if _DWELL.search(line):
                    self._dwells.append(index)
        self._open.extend(lines)
        self.sent += len(lines)

    def count_ok(self, count: int, *, dwells_end: bool = True) -> None:
        """Count the `ok`s to the oldest unanswered lines.

        dwells_end : a dwell that is answered is over. A reset breaks one off, and it is answered
            all the same.
        """
        done = self._take_answers(count)
        if self._rejected is None:
            self.acknowledged = self._answered
            if dwells_end:
                self._count_executed(done)

    def count_rejected(self) -> bool:
        """Count another answer to the oldest unanswered line; True if it is the first one."""
        first = self._rejected is None
        if first:
            self._rejected = self._answered
        self._take_answers(1)
        return first

    def _take_answers(self, count: int) -> int:
        """How many lines the last dwell among them is, or as many as are executed."""
        self._answered += count
        done = self.executed
        while self._dwells and self._dwells[0] < self._answered:
            done = self._dwells.popleft() + 1
        return done

    def unanswered_bytes(self) -> int:
        """Bytes of the lines sent and not answered, line ends included."""
        waiting = islice(self._open, self._answered - self.executed, None)
        return self.lines_unanswered + sum(map(len, waiting))

    def oldest_unanswered_line(self) -> bytes | None:
        """The line whose answer is due next, or None."""
        at = self._answered - self.executed
        return self._open[at] if at < len(self._open) else None

    def min_planned_lines(self, head: int, blocks_free: int | None) -> int:
        """How many lines have been planned at least, with `N head` at the planner's head.

        Each block in the planner is of another line; a line may have made none. The number of
        blocks may not be reported, but the planner holds at least that one.
        """
        blocks = 1 if blocks_free is None else self._planner_blocks - blocks_free
        at = self._place_of(head)
        if at is None or blocks <= 0:
            return 0
        first = self.executed + at
        planned = first + blocks
        for index in self._blockless:
            if index >= planned:
                break
            planned += index >= first
        return min(planned, self.sent)

    def on_status_report(self, report: StatusReport, now_s: float) -> bool:
        """Take a status report, in its place among the answers; True if `executed` grew."""
        idle = report.state == "Idle"
        done = left = self.executed
        if report.state in _MOVING:
            left = self._lines_out_of_planner(report)
            if report.is_held:
                done = left
                self._left_planner.clear()
            else:
                self._left_planner.append((now_s, left))
        elif not idle:  # an alarm kills what is in the segment buffer
            self._left_planner.clear()
        else:
            has_count = report.line_number is not None or report.planner_blocks_free is not None
            left = self._lines_out_of_planner(report) if has_count else self._answered
            if self._answered == self.sent and self._planner_is_empty(report):
                done = self._answered
        self._idle_answered = self._answered if idle else -1
        while self._left_planner and now_s - self._left_planner[0][0] >= self._lead_s:
            done = max(done, min(self._left_planner.popleft()[1], left))
        done = min(done, self.acknowledged)
        if done <= self.executed:
            return False
        self._count_executed(done)
        return True

    def _count_executed(self, done: int) -> None:
        for _ in range(done - self.executed):
            self._open.popleft()
        while self._blockless and self._blockless[0] < done:
            self._blockless.popleft()
        self.executed = done

    def _lines_out_of_planner(self, report: StatusReport) -> int:
        if report.line_number is not None:
            return self._before_line(report.line_number)
        if report.planner_blocks_free is not None:
            return self._before_blocks(self._planner_blocks - report.planner_blocks_free)
        return self.executed

    def _planner_is_empty(self, report: StatusReport) -> bool:
        if report.planner_blocks_free is not None:
            return report.planner_blocks_free >= self._planner_blocks
        # Without Bf: a line may be planned and motion not begun; the next report would show it.
        return self._idle_answered == self._answered

    def _before_line(self, number: int) -> int:
        return self.executed + (self._place_of(number) or 0)

    def _place_of(self, number: int) -> int | None:
        """Position of the line `N number` among those sent and not executed; None: not there."""
        same, index = self._placed
        if number == same and index >= self.executed:
            return index - self.executed
        word = b"N%d" % number
        # Lines mostly count on, so it stands as much further on as its number is greater.
        at = index + number - same - self.executed
        if not (0 <= at < len(self._open) and _numbered(self._open[at], word)):
            numbered = (n for n, line in enumerate(self._open) if _numbered(line, word))
            if (found := next(numbered, None)) is None:
                return None
            at = found
        self._placed = number, self.executed + at
        return at

    def _before_blocks(self, blocks: int) -> int:
        """The index of the (blocks + 1)th last acknowledged line that makes a block."""
        answered = list(islice(self._open, self._answered - self.executed))
        wanted = blocks + 1
        for at in range(len(answered) - 1, -1, -1):
            if makes_planner_block(answered[at]) and self.executed + at != self._rejected:
                wanted -= 1
                if wanted == 0:
                    return self.executed + at
        return self.executed


def _numbered(line: bytes, word: bytes) -> bool:
    return line.startswith(word) and not line[len(word) : len(word) + 1].isdigit()


def makes_planner_block(line: bytes) -> bool:
    """Whether a G-code line has axis words, and so makes a planner block if it goes anywhere."""
    return b"X" in line or b"Y" in line or b"Z" in line
