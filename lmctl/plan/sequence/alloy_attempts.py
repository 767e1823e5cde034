"""Sequence a layer again and again until what it is predicted to deposit keeps the alloy rules."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.sequence.alloy_watch import AlloyWatch
from lmctl.plan.sequence.bead_pieces import BeadPieces
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow
from lmctl.plan.sequence.track_order import OrderedTracks

#: How often a layer is sequenced to keep alloy rules where powder comes late.
MAX_ATTEMPTS = 12

#: A layer as it would be deposited: its pieces, lines, their ends [s], and the flow at the nozzle.
Attempt = tuple[BeadPieces, Moves, FloatArray, PowderFlow]


def tracks_that_keep_rules(
    tracks: OrderedTracks, watch: AlloyWatch, where: str,
    attempt: Callable[[OrderedTracks, FloatArray], Attempt], *, is_uniform: bool, leads: bool,
) -> tuple[OrderedTracks, FloatArray]:
    """Tracks, and time beside what powder needs before each (m,) [s], that lay nothing forbidden.

    attempt : sequences tracks with such times; is_uniform : each track has one mixture
    leads : whether powder is led: else nothing here could make it come in time
    What is still laid late after the last attempt is refused by `AlloyWatch.check`.
    """
    if not is_uniform:
        tracks = watch.cut_between_levels(tracks, where)
    wait_s = np.zeros(tracks.n_tracks)
    for _ in range(MAX_ATTEMPTS if leads else 0):
        mended = watch.mended(tracks, wait_s, *attempt(tracks, wait_s))
        if mended is None:
            break
        tracks, wait_s = mended
    return tracks, wait_s
