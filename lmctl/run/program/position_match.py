"""Program time of a reported position: where it is on the lines that may be running."""

from __future__ import annotations

import math

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.layer_program import LayerProgram

#: How far the nozzle may be from the start of the line that runs by the count of executed ones.
#: Where the count comes from planner blocks (Bf), it is only known to a line or two.
_LOOK_BACK_S, _LOOK_AHEAD_S = 0.15, 0.55

#: A position so near to where it is expected needs no search for the line it lies on.
_EXPECTED_S, _EXPECTED_MM = 0.05, 0.01

#: Distance that a deviation of one second from the expected time counts as [mm/s]: it only
#: decides where a path lies on itself.
_TIME_WEIGHT_MM_S = 0.02


def time_where_expected(
    window: JobWindow, position_mm: tuple[float, ...], expected_s: float
) -> float | None:
    """Program time of a position that lies where it is expected, found without a search."""
    start, end, start_s, end_s = window.line_span_at_program_time(expected_s)
    (x0, y0, z0), (x1, y1, z1) = start, end
    x, y, z = position_mm[:3]
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    length2 = dx * dx + dy * dy + dz * dz
    if length2 == 0.0:
        return None
    share = ((x - x0) * dx + (y - y0) * dy + (z - z0) * dz) / length2
    off2 = (
        (x - x0 - share * dx) ** 2 + (y - y0 - share * dy) ** 2 + (z - z0 - share * dz) ** 2
    )
    found_s = start_s + share * (end_s - start_s)
    near = abs(found_s - expected_s) < _EXPECTED_S and off2 < _EXPECTED_MM**2
    return found_s if near and 0.0 <= share <= 1.0 else None


def nearest_time(
    window: JobWindow, executed: int, acknowledged: int, position_mm: tuple[float, ...],
    expected_s: float,
) -> tuple[float, float]:
    """Program time of the point nearest to a position, on the lines that may be running.

    And how far it is from there [mm].
    """
    start_mm, end_mm, start_s, end_s = _around(window, executed, acknowledged, expected_s)
    along_mm = end_mm - start_mm
    lasting_s = end_s - start_s
    from_start_mm = np.array(position_mm[:3]) - start_mm
    length2 = np.einsum("ij,ij->i", along_mm, along_mm)
    moves = length2 > 0.0
    share = np.einsum("ij,ij->i", from_start_mm, along_mm)
    np.divide(share, length2, out=share, where=moves)
    # On a line that does not move (a dwell), only the expected time shows the progress.
    waits = ~moves & (lasting_s > 0.0)
    share[~moves] = 0.0
    share[waits] = (expected_s - start_s[waits]) / lasting_s[waits]
    np.clip(share, 0.0, 1.0, out=share)
    at_s = start_s + share * lasting_s
    off_mm = from_start_mm - share[:, None] * along_mm
    off_mm2 = np.einsum("ij,ij->i", off_mm, off_mm)
    best = int((off_mm2 + (_TIME_WEIGHT_MM_S * (at_s - expected_s)) ** 2).argmin())
    return float(at_s[best]), math.sqrt(off_mm2[best])


def _around(
    window: JobWindow, line: int, acknowledged: int, expected_s: float
) -> tuple[FloatArray, ...]:
    """Starts and ends, in place and time, of the lines that may be running."""
    layer = window.layer_program_of_line(line)
    row = line - layer.first_line
    start_s = layer.start_s[row]
    first = int(layer.end_s.searchsorted(start_s - _LOOK_BACK_S))
    # The count is a report late: long periods and overrides bring the nozzle farther by then.
    until_s = max(start_s + _LOOK_AHEAD_S, expected_s + _LOOK_BACK_S)
    last = int(layer.start_s.searchsorted(until_s, side="right"))
    near = _rows(layer, min(first, row), last)
    if last < len(layer.program) or layer.last_line + 1 >= acknowledged:
        return near
    after = window.layer_program(layer.index + 1)
    last = int(after.start_s.searchsorted(until_s, side="right"))
    return tuple(map(np.concatenate, zip(near, _rows(after, 0, last), strict=True)))


def _rows(layer: LayerProgram, first: int, last: int) -> tuple[FloatArray, ...]:
    rows = slice(first, last)
    return (layer.start_mm[rows], layer.end_mm[rows], layer.start_s[rows],
            layer.end_s[rows])
