"""Orders of a layer's tracks in which the beam comes back later to what is hot.

Tracks of equal mixture are free to be deposited in any order. Nearest first travels least, but goes
from a track to its neighbour, and from an island to itself in the layer above. Which order takes
the least time is found by trying: waits for heat and way together decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.track_order import OrderedTracks

if TYPE_CHECKING:
    from lmctl.plan.heat import HeatPlanner

#: Tracks are kept away from so many before them.
_REMEMBERED = 3
#: More tracks of one mixture than these are left nearest first: pairs of them would be many.
_MOST_TRACKS = 400


#: Orders of tracks of equal mixture that are tried beside nearest first.
HeatOrder = Literal["coolest", "apart"]
#: A new order of some tracks (k,) of one mixture.
Rearrangement = Callable[[IndexArray], IndexArray]


@dataclass(frozen=True)
class OrderAttempt:
    """A layer's tracks in one order.

    beads : interrupted where heat needs it; None without tracks
    wait_s : (m,) time before each bead beside what powder needs; heat_wait_s : (m,) the wait for
        heat, or for the layer's least time; None where there is none
    lasting_s : of the whole layer; 0 where it is not compared with another order's
    """

    tracks: OrderedTracks
    beads: Beads | None
    wait_s: FloatArray | None
    heat_wait_s: FloatArray | None
    lasting_s: float


def quickest_attempt(
    heat: HeatPlanner, geometry: LayerGeometry, offset_mm: FloatArray, nearest: OrderAttempt,
    ordered: Callable[[Rearrangement], OrderedTracks],
    attempt: Callable[[OrderedTracks], OrderAttempt],
) -> OrderAttempt:
    """The order that takes least time, waits included; `heat.choice` is that of it.

    offset_mm : (3,) of the part in program coordinates
    nearest : the attempt made already, nearest first: without waits, it stays
    """
    best, choice = nearest, heat.choice
    if not choice.is_compared or geometry.n_tracks < 2:
        return best
    found_C = heat.surface_C(geometry.points_mm + offset_mm[:2])
    orders: tuple[HeatOrder, ...] = ("coolest", "apart")
    for order in orders:
        tracks = ordered(rearrangement_of(order, geometry, found_C))
        if np.array_equal(tracks.points_mm, nearest.tracks.points_mm):
            continue
        heat.begin_attempt(order)
        other = attempt(tracks)
        if other.lasting_s < best.lasting_s:
            best, choice = other, heat.choice
    heat.choice = choice
    return best


def rearrangement_of(
    order: HeatOrder, geometry: LayerGeometry, found_C: FloatArray
) -> Rearrangement:
    """How an order changes tracks that are nearest first.

    found_C : (n,) temperature at the layer's vertices as it begins
    """
    first, size = geometry.starts[:-1], np.diff(geometry.starts)
    track_C = np.add.reduceat(np.nan_to_num(found_C), first) / size
    if order == "coolest":
        return lambda tracks: tracks[np.argsort(track_C[tracks], kind="stable")]
    middle_mm = np.add.reduceat(geometry.points_mm, first, axis=0) / size[:, None]
    return lambda tracks: _far_apart(tracks, middle_mm, track_C)


def _far_apart(tracks: IndexArray, middle_mm: FloatArray, track_C: FloatArray) -> IndexArray:
    """From the coolest on, always the one farthest from the last few; middle_mm : (m, 2)."""
    if len(tracks) > _MOST_TRACKS:
        return tracks
    left = tracks[np.argsort(track_C[tracks], kind="stable")].tolist()
    done = [left.pop(0)]
    while left:
        away = np.min([np.hypot(*(middle_mm[left] - middle_mm[track]).T)
                       for track in done[-_REMEMBERED:]], axis=0)
        done.append(left.pop(int(np.argmax(away))))
    return np.array(done, np.intp)
