"""What has become of each program line: how far it was moved, lit or dark, and drawn how often."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.motion.trace import MotionTrace

FloatArray = NDArray[np.float64]

#: Less than this is not counted as drawn again [mm].
_SAME_MM = 0.01


@dataclass(frozen=True)
class ExecutedLine:
    """One move that was begun. line : N word, 0 without; executed_fraction : of it that was moved

    beam_on_mm : length moved with the beam lit; start_mm, end_mm : where the axes really were
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
    """What the beam drew of one N word, however often. beam_on_mm : covered at least once

    repeated_mm : drawn again
    """

    line: int
    beam_on_mm: float
    repeated_mm: float


def executed_lines(trace: MotionTrace, now_s: float) -> tuple[ExecutedLine, ...]:
    """Every move begun by now, in order."""
    blocks = trace.blocks()
    lit_mm = _lit_mm(trace, now_s, len(blocks.line))
    return tuple(
        ExecutedLine(
            int(blocks.line[i]), float(blocks.start_s[i]), float(blocks.end_s[i]),
            float(blocks.executed_fraction[i]), float(lit_mm[i]),
            _point(blocks.start_mm[i]), _point(blocks.end_mm[i]),
        )
        for i in range(len(blocks.line)) if blocks.start_s[i] <= now_s
    )


def beam_on_length_by_line(executed: Sequence[ExecutedLine]) -> tuple[BeamOnLine, ...]:
    """What the beam drew, by N word; moves without one are left out."""
    pieces: dict[int, list[ExecutedLine]] = {}
    for one in executed:
        if one.line and one.beam_on_mm > 0:
            pieces.setdefault(one.line, []).append(one)
    return tuple(_drawn(line, same) for line, same in sorted(pieces.items()))


def _lit_mm(trace: MotionTrace, now_s: float, n_blocks: int) -> FloatArray:
    """(n,) length moved with the beam lit, of each block."""
    phases = trace.phases()
    until_s = np.minimum(phases.end_s, now_s)
    dt = np.maximum(0.0, until_s - phases.start_s)
    moved = (phases.speed_mm_s + 0.5 * phases.acceleration_mm_s2 * dt) * dt
    lit = phases.power > 0
    total = np.bincount(phases.block[lit], moved[lit], minlength=n_blocks)
    return total.astype(np.float64)


def _drawn(line: int, pieces: Sequence[ExecutedLine]) -> BeamOnLine:
    """Lit lengths along the direction of the longest piece, covered once and covered again.

    A piece counts as lit from its start: the beam of a line goes on with it.
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
