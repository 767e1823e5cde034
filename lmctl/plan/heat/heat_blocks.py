"""Where in a layer there may be waits: before paths, and within long ones."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.heat.heat_steps import BeadLines

#: A wait may lie so long after the one before, or where a gap with the beam off lasts so long
#: anyway: powder changes in it [s].
_BLOCK_S, _GAP_S = 3.0, 1.0
#: The shortest piece of a path that a wait may leave, in beads.
MIN_PIECE_BEADS = 2.0


def finely_divided(
    lines: BeadLines, along_mm: FloatArray, longest_mm: float
) -> tuple[BeadLines, IndexArray, FloatArray]:
    """Lines no longer than `longest_mm`, so that a wait can lie within a long straight one.

    along_mm : (n, 2) where on the tracks each line begins and ends
    Returns k lines, the first of those that each line is divided into, (n,), and where on the
    tracks each of the k begins, (k,).
    """
    into = np.maximum(np.ceil(np.diff(_lengths_mm(lines)) / longest_mm), 1).astype(np.intp)
    first_part = np.cumsum(into) - into
    line = np.repeat(np.arange(len(into)), into)
    share = (np.arange(len(line)) - first_part[line]) / into[line]
    begin_mm, end_mm = along_mm[line].T
    return lines.divided(into), first_part, begin_mm + share * (end_mm - begin_mm)


def block_starts(lines: BeadLines, first: IndexArray, piece_mm: float) -> list[int]:
    """Lines before which there may be a wait, rising, the first of all included.

    lines : n bead lines of a layer; first : (m,) the first line of each path
    piece_mm : the shortest piece of a path between two waits
    """
    starts = [0]
    length_mm = _lengths_mm(lines)
    ends = [*first[1:].tolist(), len(lines.start_s)]
    for begin, end in zip(first.tolist(), ends, strict=True):
        if begin and (lines.start_s[begin] - lines.end_s[begin - 1] >= _GAP_S
                      or lines.start_s[begin] - lines.start_s[starts[-1]] >= _BLOCK_S):
            starts.append(begin)
        inside = np.flatnonzero(
            (length_mm[begin:end] - length_mm[begin] >= piece_mm)
            & (length_mm[end] - length_mm[begin:end] >= piece_mm)) + begin
        for line in inside.tolist():
            if lines.start_s[line] - lines.start_s[starts[-1]] >= _BLOCK_S:
                starts.append(line)
    return starts


def middle_of_block(
    lines: BeadLines, first: IndexArray, begin: int, end: int, piece_mm: float
) -> int | None:
    """The line nearest to the middle of lines `begin` to `end` − 1 that a wait may precede: where a
    path begins, or within one, away from its ends; None where there is none."""
    length_mm = _lengths_mm(lines)
    inside = np.arange(begin + 1, end)
    starts = first[(first > begin) & (first < end)]
    edges = np.unique(np.concatenate([[begin, end], starts]))
    after = np.searchsorted(edges, inside, side="right")
    to_end_mm = length_mm[edges[np.minimum(after, len(edges) - 1)]] - length_mm[inside]
    whole = (length_mm[inside] - length_mm[edges[after - 1]] >= piece_mm) & (to_end_mm >= piece_mm)
    candidates = inside[whole | np.isin(inside, starts)]
    if len(candidates) == 0:
        return None
    middle = (length_mm[begin] + length_mm[end]) / 2
    return int(candidates[np.argmin(np.abs(length_mm[candidates] - middle))])


def _lengths_mm(lines: BeadLines) -> FloatArray:
    """Length of bead before each line, and of all, (n + 1,)."""
    step_mm = np.sqrt(((lines.end_mm - lines.start_mm) ** 2).sum(axis=1))
    return np.concatenate([[0.0], np.cumsum(step_mm)])
