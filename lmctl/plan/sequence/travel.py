"""A layer's beads joined into moves: travel, lead-in, bead, lead-out.

Travel is G1 at S0, not G0: a feed override then scales the whole program evenly, travel and
powder ramps included. Within a layer the nozzle goes straight to a path that begins within three
bead widths, and else lifts by the clearance, crosses, and comes down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.flat_arrays import indices_within_stretches
from lmctl.plan.sequence.moves import Moves, moves_of_kind

#: Travel up to this many bead widths stays at the layer's height.
STRAIGHT_TRAVEL_BEADS = 3.0
#: Layers begin at rest: a dwell this short drains the planner, so that each has its own velocity
#: profile.
LAYER_REST_S = 0.01
#: Vertices nearer to each other than this have no direction between them [mm].
_NO_WAY_MM = 0.002
#: Stops of a travel that lifts, crosses and comes down.
_LIFTED = 3


@dataclass(frozen=True)
class TravelSettings:
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
    beads: Beads, z_mm: float, offset_mm: FloatArray, start_mm: FloatArray,
    settings: TravelSettings, last: FloatArray,
) -> Moves:
    """All moves of a layer, from the nozzle position to the last lead-out.

    beads : in order, in the part's coordinates; offset_mm : (3,) of the part
    start_mm : (3,) nozzle position; last : (materials,) mixture deposited last
    """
    points = beads.points_mm + offset_mm[:2]
    entry = points[beads.first] - settings.lead_in_mm * _directions(points, beads.first, +1)
    leave = points[beads.last] - settings.lead_in_mm * _directions(points, beads.last, -1)
    come_from = np.vstack([start_mm, np.column_stack([leave, np.full(beads.count, z_mm)])[:-1]])
    way = np.sqrt(((entry - come_from[:, :2]) ** 2).sum(axis=1))
    straight = (come_from[:, 2] == z_mm) & (way <= STRAIGHT_TRAVEL_BEADS * settings.bead_mm)
    mixture_before = np.vstack([last, beads.fractions[beads.last][:-1]])
    change = np.abs(beads.fractions[beads.first] - mixture_before).max(axis=1, initial=0.0)
    waits = (change > settings.dwell_step) & (settings.dwell_s > 0)
    # Of each path: travel, perhaps a dwell, lead-in, the bead's segments, lead-out.
    n_travel = np.where(straight, 1, _LIFTED)
    n_segments = np.diff(beads.starts) - 1
    size = n_travel + waits + 1 + n_segments + 1
    begin = 1 + np.cumsum(size) - size
    moves = _empty(1 + int(size.sum()), beads.fractions.shape[1], z_mm)
    moves.kind[0], moves.dwell_s[0] = LineKind.DWELL, LAYER_REST_S
    moves.target_mm[0], moves.fractions[0] = start_mm, last
    path = np.repeat(np.arange(beads.count), size)
    moves.fractions[1:] = beads.fractions[beads.first][path]
    _add_travel(moves, begin, straight, come_from, entry, settings)
    dwell = (begin + n_travel)[waits]
    moves.kind[dwell], moves.dwell_s[dwell] = LineKind.DWELL, settings.dwell_s
    moves.target_mm[dwell, :2], moves.feed_mm_s[dwell] = entry[waits], 0.0
    lead_in = begin + n_travel + waits
    _add_leads(moves, beads, points, lead_in, leave, settings)
    segment = np.repeat(lead_in + 1, n_segments) + indices_within_stretches(n_segments)
    vertex = np.ones(len(points), dtype=np.bool_)
    vertex[beads.first] = False
    moves.target_mm[segment, :2] = points[vertex]
    moves.kind[segment] = LineKind.BEAD
    moves.feed_mm_s[segment] = beads.speed_mm_s[vertex]
    moves.power_W[segment] = beads.power_W[vertex]
    moves.bead_width_mm[segment] = beads.width_mm[vertex]
    moves.fractions[segment] = beads.fractions[vertex]
    moves.along_mm[segment, 0] = beads.along_mm[np.flatnonzero(vertex) - 1]
    moves.along_mm[segment, 1] = beads.along_mm[vertex]
    on_path = np.concatenate([lead_in, segment, lead_in + n_segments + 1])
    moves.path[on_path] = path[on_path - 1]
    return moves


def moves_to_purge_position(
    at_mm: FloatArray, home_mm: FloatArray, settings: TravelSettings, last: FloatArray
) -> Moves:
    """Up from the part, across, and to the purge position."""
    top = max(at_mm[2] + settings.clearance_mm, home_mm[2])
    stops = np.array([[at_mm[0], at_mm[1], top], [home_mm[0], home_mm[1], top], home_mm])
    return moves_of_kind(stops, feed_mm_s=settings.travel_mm_s, kind=LineKind.TRAVEL,
                         fractions=last)


def _empty(n: int, n_materials: int, z_mm: float) -> Moves:
    target = np.zeros((n, 3))
    target[:, 2] = z_mm
    return Moves(
        target_mm=target, feed_mm_s=np.zeros(n), power_W=np.zeros(n), kind=np.zeros(n, np.uint8),
        path=np.full(n, -1, np.int32), fractions=np.zeros((n, n_materials)), dwell_s=np.zeros(n),
        bead_width_mm=np.zeros(n), along_mm=np.zeros((n, 2)))


def _add_travel(
    moves: Moves, begin: IndexArray, straight: NDArray[np.bool_], come_from: FloatArray,
    entry: FloatArray, settings: TravelSettings,
) -> None:
    """Beam-off moves from one path's end to the next one's lead-in."""
    near, far = begin[straight], begin[~straight]
    moves.target_mm[near, :2] = entry[straight]
    top = np.maximum(come_from[~straight, 2], moves.target_mm[far, 2] + settings.clearance_mm)
    moves.target_mm[far, :2] = come_from[~straight, :2]
    moves.target_mm[far + 1, :2] = moves.target_mm[far + 2, :2] = entry[~straight]
    moves.target_mm[far, 2] = moves.target_mm[far + 1, 2] = top
    for index in (near, far, far + 1, far + 2):
        moves.kind[index], moves.feed_mm_s[index] = LineKind.TRAVEL, settings.travel_mm_s


def _add_leads(
    moves: Moves, beads: Beads, points: FloatArray, lead_in: IndexArray, leave: FloatArray,
    settings: TravelSettings,
) -> None:
    """The lead-in ends where the bead begins; the lead-out begins where it ends."""
    moves.kind[lead_in] = LineKind.LEAD
    moves.target_mm[lead_in, :2] = points[beads.first]
    moves.feed_mm_s[lead_in] = beads.speed_mm_s[beads.first + 1]
    lead_out = lead_in + np.diff(beads.starts)
    moves.kind[lead_out] = LineKind.LEAD
    moves.target_mm[lead_out, :2] = leave
    # the beam is off, and is left at the bead's own speed: from there on the nozzle may hurry
    moves.feed_mm_s[lead_out] = settings.travel_mm_s
    moves.fractions[lead_out] = beads.fractions[beads.last]


def _directions(points: FloatArray, ends: IndexArray, towards: int) -> FloatArray:
    """Unit vectors (m, 2) from the end vertices of beads to the next one that is elsewhere."""
    step = points[ends + towards] - points[ends]
    length = np.sqrt((step**2).sum(axis=1))
    for bead in np.flatnonzero(length <= _NO_WAY_MM):  # few: vertices are farther apart
        other, at = ends[bead] + towards, points[ends[bead]]
        while 0 <= other < len(points) and np.hypot(*(points[other] - at)) <= _NO_WAY_MM:
            other += towards
        inside = 0 <= other < len(points)
        step[bead] = points[other] - at if inside else (1.0, 0.0)
        length[bead] = np.hypot(*step[bead])
    return np.asarray(step / length[:, None])
