"""Open tracks that go on, from an end, into a closed one beside it or into another open one."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.link_lines import (
    MIN_LOOP_BRIDGE_LENGTHS,
    LinkableTrack,
    LinkRules,
    arc_lengths_of,
    rows_between_arc_lengths,
)
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.plane_values import interpolate_bilinear
from lmctl.plan.polyline import densified_polyline


def joined_at_ends(
    lines: list[LinkableTrack], raster: SectionRaster, rules: LinkRules
) -> list[LinkableTrack]:
    """Open lines joined, end by end, to closed lines and to each other, the nearest first."""
    joined: list[LinkableTrack] = []
    for island in sorted({line.island for line in lines}):
        joined += _joined_in_island(
            [line for line in lines if line.island == island], raster, rules)
    return joined


def _joined_in_island(
    lines: list[LinkableTrack], raster: SectionRaster, rules: LinkRules
) -> list[LinkableTrack]:
    """`joined_at_ends` of one island."""
    if all(line.is_closed for line in lines):
        return lines
    known = dict(enumerate(lines))
    boxes = {key: _reachable_box(line, rules) for key, line in known.items()}
    number = len(lines)
    nearest: dict[tuple[int, int], tuple[float, int, int] | None] = {}
    while True:
        for key, line in known.items():
            for end in (0, -1):
                if not line.is_closed and (key, end) not in nearest:
                    nearest[key, end] = _nearest_line(key, end, known, boxes, raster, rules)
        found = [(best[0], key, end, best) for (key, end), best in nearest.items()
                 if best is not None]
        if not found:
            return list(known.values())
        _, key, end, (_, other, vertex) = min(found)
        joined = _joined(known.pop(key), end, known.pop(other), vertex, rules)
        gone = {key, other}
        # An end without a neighbour gets none: what is joined lies where its parts lay.
        nearest = {(k, e): best for (k, e), best in nearest.items()
                   if k not in gone and (best is None or best[1] not in gone)}
        known[number] = joined
        boxes[number] = _reachable_box(joined, rules)
        number += 1


def _reachable_box(line: LinkableTrack, rules: LinkRules) -> tuple[float, float, float, float]:
    """Lowest x and y and highest x and y from where a bridge may reach a line [mm]."""
    x, y = (line.table if line.is_closed else line.table[[0, -1]]).T[:2]
    low_x, high_x, low_y, high_y = float(x.min()), float(x.max()), float(y.min()), float(y.max())
    far = rules.longest_bridge_mm
    return low_x - far, low_y - far, high_x + far, high_y + far


def _nearest_line(
    number: int, end: int, lines: dict[int, LinkableTrack],
    boxes: dict[int, tuple[float, float, float, float]], raster: SectionRaster, rules: LinkRules,
) -> tuple[float, int, int] | None:
    """Distance, number and vertex of the line that an end of an open line may go on into."""
    here = lines[number].table[end]
    x, y = float(here[0]), float(here[1])
    best = None
    for other, target in lines.items():
        low_x, low_y, high_x, high_y = boxes[other]
        if other == number or not (low_x <= x <= high_x and low_y <= y <= high_y):
            continue
        candidate = _nearest_on(here, target, raster, rules)
        if candidate is not None and (best is None or candidate[0] < best[0]):
            best = (candidate[0], other, candidate[1])
    return best


def _nearest_on(
    here: FloatArray, target: LinkableTrack, raster: SectionRaster, rules: LinkRules
) -> tuple[float, int] | None:
    """Distance to a line and its vertex, where a bridge may go; of open ones an end only."""
    table = np.ascontiguousarray(target.table if target.is_closed else target.table[[0, -1]])
    nearest, away_mm = _nearest_row(table, here[0], here[1])
    if away_mm > rules.longest_bridge_mm:
        return None
    if np.abs(table[nearest, 3:] - here[3:]).max() > rules.mixture_step + 1e-9:
        return None
    way = here[:2] + np.linspace(0, 1, 5)[1:-1, None] * (table[nearest, :2] - here[:2])
    depth = interpolate_bilinear(raster.depth_mm, raster.grid, way)
    if depth.min() < rules.least_depth_mm:
        return None
    return away_mm, nearest


@kernel
def _nearest_row(table: FloatArray, x: float, y: float) -> tuple[int, float]:
    """The first row whose point is nearest to a place, and its distance."""
    nearest, least = 0, np.inf
    for k in range(len(table)):
        d2 = (table[k, 0] - x) ** 2 + (table[k, 1] - y) ** 2
        if d2 < least:
            nearest, least = k, d2
    return nearest, np.sqrt(least)


def _joined(line: LinkableTrack, end: int, target: LinkableTrack, vertex: int,
            rules: LinkRules) -> LinkableTrack:
    """An open line that goes on, from its end, into another one."""
    table = line.table if end == -1 else line.table[::-1]
    onward = target.table
    if target.is_closed:
        arc = arc_lengths_of(target)
        gap = min(float(np.hypot(*(onward[vertex, :2] - table[-1, :2]))),
                  arc[-1] / MIN_LOOP_BRIDGE_LENGTHS)
        onward = rows_between_arc_lengths(onward, arc, float(arc[vertex]),
                                          float(arc[vertex] + arc[-1] - gap))
    elif vertex == 1:
        onward = onward[::-1]
    return LinkableTrack(densified_polyline(np.vstack([table, onward]), rules.spacing_mm), False,
                         line.island)
