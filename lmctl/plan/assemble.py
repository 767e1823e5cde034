"""A layer's beads joined into moves: travel, lead-in, bead, lead-out.

Travel is G1 at S0, not G0: a feed override then scales the whole program evenly, travel and
powder ramps included. Within a layer the nozzle goes straight to a path that begins within three
bead widths, and else lifts by the clearance, crosses, and comes down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.job.schema import LineKind
from lmctl.plan.beads import Bead
from lmctl.plan.moves import Moves, join, lines

FloatArray = NDArray[np.float64]

#: Travel up to this many bead widths stays at the layer's height.
STRAIGHT_TRAVEL_BEADS = 3.0
#: Layers begin at rest: a dwell this short drains the planner, so that each has its own time law.
LAYER_REST_S = 0.01


@dataclass(frozen=True)
class Way:
    """How to move with the beam off.

    dwell_s : waited before each path whose mixture differs by more than `dwell_step`; 0 for none
    """

    travel_mm_s: float
    clearance_mm: float
    lead_in_mm: float
    bead_mm: float
    dwell_s: float
    dwell_step: float


def layer_moves(
    beads: list[Bead], z_mm: float, offset_mm: FloatArray, start_mm: FloatArray, way: Way,
    last: FloatArray,
) -> Moves:
    """All moves of a layer, from where the nozzle stands to the last lead-out.

    beads : in order, in the part's coordinates; offset_mm : (3,) of the part
    start_mm : (3,) where the nozzle stands; last : (m,) mixture laid last
    """
    parts = [lines(start_mm, feed_mm_s=0.0, kind=LineKind.DWELL, fractions=last,
                   dwell_s=LAYER_REST_S)]
    at = start_mm
    for number, bead in enumerate(beads):
        points = np.column_stack([bead.points + offset_mm[:2], np.full(len(bead.points), z_mm)])
        entry = points[0] - way.lead_in_mm * _direction(points[0], points[1:])
        exit_ = points[-1] - way.lead_in_mm * _direction(points[-1], points[-2::-1])
        parts.append(_travel(at, entry, way, bead.fractions[0]))
        if way.dwell_s > 0 and np.abs(bead.fractions[0] - last).max() > way.dwell_step:
            parts.append(lines(entry, feed_mm_s=0.0, kind=LineKind.DWELL,
                               fractions=bead.fractions[0], dwell_s=way.dwell_s))
        parts.append(lines(points[0], feed_mm_s=bead.speed_mm_s[0], kind=LineKind.LEAD,
                           fractions=bead.fractions[0], path=number))
        parts.append(lines(points[1:], feed_mm_s=bead.speed_mm_s, power_W=bead.power_W,
                           kind=LineKind.BEAD, fractions=bead.fractions[1:], path=number))
        parts.append(lines(exit_, feed_mm_s=bead.speed_mm_s[-1], kind=LineKind.LEAD,
                           fractions=bead.fractions[-1], path=number))
        at, last = exit_, bead.fractions[-1]
    return join(parts)


def way_home(at_mm: FloatArray, home_mm: FloatArray, way: Way, last: FloatArray) -> Moves:
    """Up from the part, across, and to the purge position."""
    top = max(at_mm[2] + way.clearance_mm, home_mm[2])
    stops = np.array([[at_mm[0], at_mm[1], top], [home_mm[0], home_mm[1], top], home_mm])
    return lines(stops, feed_mm_s=way.travel_mm_s, kind=LineKind.TRAVEL, fractions=last)


def _travel(at: FloatArray, to: FloatArray, way: Way, following: FloatArray) -> Moves:
    """Beam-off moves from one path's end to the next one's lead-in."""
    near = np.linalg.norm(to - at) <= STRAIGHT_TRAVEL_BEADS * way.bead_mm
    if at[2] == to[2] and near:
        stops = to[None]
    else:
        top = max(at[2], to[2] + way.clearance_mm)
        stops = np.array([[at[0], at[1], top], [to[0], to[1], top], to])
    return lines(stops, feed_mm_s=way.travel_mm_s, kind=LineKind.TRAVEL, fractions=following)


def _direction(point: FloatArray, others: FloatArray) -> FloatArray:
    """Unit vector from a point towards the first of others that is not the same point."""
    for other in others:
        step = other - point
        length = float(np.linalg.norm(step))
        if length > 0.002:
            return np.asarray(step / length)
    return np.array([1.0, 0.0, 0.0])
