"""Which lines may be sent now: never more unexecuted motion than the send horizon.

If the host dies, the controller runs dry and the beam goes off within the horizon; and no more
than the horizon has to be repeated after a crash.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.layer_program import PathSpan

#: Lines always allowed: the one that runs and the next, without which motion would stop between
#: them. Planning splits moves at a quarter of the horizon, so at half speed these two just fill it.
_MIN_LINES = 2


@dataclass(frozen=True)
class LineBatch:
    """Lines to send now, and the paths that begin in them."""

    lines: list[bytes]
    begun: list[PathSpan]


class LineReleaser:
    """Releases a job's lines as program time goes on. Knows no driver and no clock.

    released : the first line not given out yet
    """

    def __init__(self, window: JobWindow, horizon_s: float) -> None:
        self.released = window.first_layer().first_line
        self._window = window
        self._horizon_s = horizon_s
        self._end_line = window.n_lines  # no line from here on is released
        self._path_done: Callable[[], None] | None = None
        self._open: deque[PathSpan] = deque()  # begun and not yet executed

    def release(self, s: float, rate: float) -> LineBatch:
        """The lines that may be sent now that program time s has been reached.

        rate : feed override. The horizon is machine time: it holds less program time where an
            override slows motion down, more where it speeds it up.
        """
        window = self._window
        limit_s = window.advance(s, self._horizon_s, rate)
        least = window.line_at_program_time(s) + _MIN_LINES
        lines: list[bytes] = []
        begun: list[PathSpan] = []
        while self.released < self._end_line:
            layer = window.layer_program_of_line(self.released)
            first = self.released - layer.first_line
            end = max(bisect_right(layer.ends_s, limit_s),
                      min(least - layer.first_line, len(layer.program)))
            end = min(end, self._end_line - layer.first_line)
            if end <= first:
                break
            lines += layer.program[first:end]
            self.released = layer.first_line + end
            begun += layer.paths_from(layer.first_line + first, self.released)
        self._open.extend(begun)
        return LineBatch(lines, begun)

    def end_with_path(self, executed: int, path_done: Callable[[], None]) -> None:
        """Release no path that has not begun; call `path_done` once all of them are executed.

        It is not called where the job ends with them.
        """
        begun = self._open[-1].last_line + 1 if self._open else self.released
        self._end_line, self._path_done = max(begun, self.released), path_done
        self._look_for_end_of_path(executed)

    def end_before_line(self, line: int, reached: Callable[[], None]) -> None:
        """Release nothing from a line on; `reached` is called once all before it is executed."""
        self._end_line, self._path_done = line, reached

    def _look_for_end_of_path(self, executed: int) -> None:
        path_done = self._path_done
        if path_done is not None and self._end_line <= executed < self._window.n_lines:
            self._path_done = None
            path_done()

    def completed_paths(self, executed: int) -> list[PathSpan]:
        """Paths all of whose lines have been executed since the last call."""
        done: list[PathSpan] = []
        while self._open and self._open[0].last_line < executed:
            done.append(self._open.popleft())
        self._look_for_end_of_path(executed)
        return done
