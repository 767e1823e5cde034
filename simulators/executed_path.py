"""Per program line: the length moved, the length with the beam on, and the length repeated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simulators.array_types import FloatArray
from simulators.motion.trace import MotionTrace

#: A shorter repeated length counts as zero [mm].
_SAME_MM = 0.01


@dataclass(frozen=True)
class ExecutedLine:
    """One move that has begun.

    line : N word, 0 without one; executed_fraction : share of the move that was executed
    beam_on_mm : length moved with the beam on; start_mm, end_mm : actual axis positions
    """

    line: int
    begin_s: float
    end_s: float
    executed_fraction: float
    beam_on_mm: float
    start_mm: tuple[float, float, float]
    end_mm: tuple[float, float, float]


@dataclass(frozen=True)
class BeamOnLine:
    """Length of one N word moved with the beam on, over all its moves.

    beam_on_mm : length covered at least once; repeated_mm : length covered again
    """

    line: int
    beam_on_mm: float
    repeated_mm: float


def executed_lines(trace: MotionTrace, now_s: float) -> tuple[ExecutedLine, ...]:
    """Return every move that has begun by now, in order."""
    blocks = trace.blocks()
    on_mm = _beam_on_mm(trace, now_s, len(blocks.line))
    return tuple(
        ExecutedLine(
            int(blocks.line[i]), float(blocks.start_s[i]), float(blocks.end_s[i]),
            float(blocks.executed_fraction[i]), float(on_mm[i]),
            _point(blocks.start_mm[i]), _point(blocks.end_mm[i]),
        )
        for i in range(len(blocks.line)) if blocks.start_s[i] <= now_s
    )


def beam_on_length_by_line(executed: Sequence[ExecutedLine]) -> tuple[BeamOnLine, ...]:
    """Return the beam-on length by N word; moves without an N word are left out."""
    pieces: dict[int, list[ExecutedLine]] = {}
    for one in executed:
        if one.line and one.beam_on_mm > 0:
            pieces.setdefault(one.line, []).append(one)
    return tuple(_beam_on_line(line, same) for line, same in sorted(pieces.items()))


def _beam_on_mm(trace: MotionTrace, now_s: float, n_blocks: int) -> FloatArray:
    """(n,) length of each block moved with the beam on."""
    phases = trace.phases()
    until_s = np.minimum(phases.end_s, now_s)
    dt = np.maximum(0.0, until_s - phases.start_s)
    moved = (phases.speed_mm_s + 0.5 * phases.acceleration_mm_s2 * dt) * dt
    beam_on = phases.power > 0
    total = np.bincount(phases.block[beam_on], moved[beam_on], minlength=n_blocks)
    return total.astype(np.float64)


def _beam_on_line(line: int, pieces: Sequence[ExecutedLine]) -> BeamOnLine:
    """Beam-on lengths along the direction of the longest piece: covered once and covered again.

    The beam counts as on from the start of a piece, because it comes on with the line.
    """
    longest = max(pieces, key=lambda one: one.beam_on_mm)
    origin = np.array(longest.start_mm)
    along = np.array(longest.end_mm) - origin
    along /= np.linalg.norm(along)
    spans = []
    total_mm = 0.0
    for one in pieces:
        start = float((np.array(one.start_mm) - origin) @ along)
        end = float((np.array(one.end_mm) - origin) @ along)
        spans.append((min(start, end), max(start, end)))
        total_mm += one.beam_on_mm
    covered_mm, reached = 0.0, -math.inf
    for begin, end in sorted(spans):
        covered_mm += max(0.0, end - max(begin, reached))
        reached = max(reached, end)
    covered_mm = min(covered_mm, total_mm)
    again_mm = total_mm - covered_mm
    return BeamOnLine(line, covered_mm, again_mm if again_mm > _SAME_MM else 0.0)


def _point(place: FloatArray) -> tuple[float, float, float]:
    return (float(place[0]), float(place[1]), float(place[2]))
