"""Parallel lines that fill a region, joined to a zigzag where that crosses nothing."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.planar_region import loops_of, pieces_of
from lmctl.plan.geometry.toolpath import Toolpath

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: The shortest line, in pitches.
_LEAST_LENGTH_PITCHES = 0.5
#: Ends of lines farther apart along them than this are not joined, in pitches.
_MOST_SKEW_PITCHES = 2.0


def hatch_lines(
    region: CrossSection, pitch_mm: float, angle: float, *, zigzag: bool
) -> list[Toolpath]:
    """Lines about a pitch apart, each piece of the region filled by itself.

    angle : of the lines, from x [radians]
    zigzag : neighbouring lines are joined, else all run in the direction of `angle`
    The strip of a line is the height of its piece over the number of lines, so that the sum of
    strips is the region's area.
    """
    found = []
    for piece in pieces_of(region):
        rows, strip = _rows(piece.rotate(-np.degrees(angle)), pitch_mm)
        chains = _zigzags(rows, strip) if zigzag else [
            np.array([[a, y], [b, y]]) for y, spans in rows for a, b in spans]
        cos, sin = np.cos(angle), np.sin(angle)
        back = np.array([[cos, sin], [-sin, cos]])
        found += [Toolpath(chain @ back, np.full(len(chain), strip), False) for chain in chains]
    return found


def _rows(
    turned: CrossSection, pitch_mm: float
) -> tuple[list[tuple[float, list[tuple[float, float]]]], float]:
    """Lines along x: y of each and its spans from x to x; and their distance."""
    _, low, _, high = turned.bounds()
    count = max(1, round((high - low) / pitch_mm))
    strip = (high - low) / count
    edges = np.vstack([np.hstack([loop[:-1], loop[1:]]) for loop in loops_of(turned)])
    rows = []
    for number in range(count):
        y = low + (number + 0.5) * strip
        crossed = edges[(edges[:, 1] > y) != (edges[:, 3] > y)]
        part = (y - crossed[:, 1]) / (crossed[:, 3] - crossed[:, 1])
        x = np.sort(crossed[:, 0] + part * (crossed[:, 2] - crossed[:, 0]))
        spans = [(float(a), float(b)) for a, b in zip(x[::2], x[1::2], strict=True)
                 if b - a >= _LEAST_LENGTH_PITCHES * pitch_mm]
        rows.append((y, spans))
    return rows, strip


def _zigzags(
    rows: list[tuple[float, list[tuple[float, float]]]], strip_mm: float
) -> list[FloatArray]:
    """Chains of lines, each joined to the one above it at the end it reaches.

    A joint replaces as much of both lines as it is long, so that what is deposited stays the same.
    """
    open_: list[list[FloatArray]] = []
    done: list[list[FloatArray]] = []
    before: list[tuple[float, float]] = []
    for y, spans in rows:
        over = [[k for k, (a, b) in enumerate(before) if a < d and b > c] for c, d in spans]
        counts = np.bincount([k for one in over for k in one], minlength=len(before))
        now: list[list[FloatArray]] = []
        taken = set()
        for (c, d), one in zip(spans, over, strict=True):
            chain = open_[one[0]] if len(one) == 1 and counts[one[0]] == 1 else None
            line = np.array([[c, y], [d, y]])
            if chain is not None and chain:
                towards_right = bool(chain[-1][1, 0] > chain[-1][0, 0])
                line = line[::-1] if towards_right else line
                if _can_join(chain[-1], line, strip_mm):
                    taken.add(one[0])
                    now.append([*chain, line])
                    continue
            now.append([line])
        done += [chain for k, chain in enumerate(open_) if k not in taken]
        open_, before = now, spans
    return [_with_joints(chain, strip_mm) for chain in [*done, *open_]]


def _can_join(last: FloatArray, line: FloatArray, strip_mm: float) -> bool:
    lengths = abs(last[1, 0] - last[0, 0]), abs(line[1, 0] - line[0, 0])
    skew = abs(last[1, 0] - line[0, 0])
    return bool(skew <= _MOST_SKEW_PITCHES * strip_mm and min(lengths) > 2 * (skew + strip_mm))


def _with_joints(chain: list[FloatArray], strip_mm: float) -> FloatArray:
    points = [chain[0][0]]
    for last, line in pairwise(chain):
        way = np.sign(last[1, 0] - last[0, 0])
        cut = way * np.hypot(last[1, 0] - line[0, 0], strip_mm) / 2
        points.append(last[1] - [cut, 0.0])
        points.append(line[0] - [cut, 0.0])
    points.append(chain[-1][1])
    return np.array(points)
