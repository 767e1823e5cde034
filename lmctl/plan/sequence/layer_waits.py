"""Choose how long the beam stays off before beads of a layer, and where they are interrupted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.beads import Beads
from lmctl.plan.sequence.beam_off_waits import PurgePosition, with_waits
from lmctl.plan.sequence.interrupted_beads import beads_with_waits
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.velocity_profile import line_durations

if TYPE_CHECKING:
    from lmctl.plan.heat import HeatPlanner

#: Waits for heat are chosen so often: a path that is interrupted takes other times than before.
_ROUNDS = 4


@dataclass(frozen=True)
class LayerWaits:
    """What makes the beam of one part wait.

    least_layer_time_s : from the first bead of a layer to the first of the next
    heat : predicts temperature; None where none is limited
    """

    least_layer_time_s: float
    heat: HeatPlanner | None
    motion: MotionSettings
    purge: PurgePosition

    def choose(
        self, index: int, beads: Beads, lines_of: Callable[[Beads], Moves], start_mm: FloatArray,
        since_first_bead_s: float | None,
    ) -> tuple[Beads, FloatArray | None]:
        """The beads, interrupted where heat needs it, and the wait before each, (m,); None where
        nothing makes the beam wait.

        index : of the layer in the job; lines_of : its lines from `start_mm`, without waits
        since_first_bead_s : time since the first bead of the layer before, None in the first
        """
        if self.heat is None and not self.least_layer_time_s:
            return beads, None
        moves = lines_of(beads)
        waits = np.zeros(beads.count)
        if since_first_bead_s is not None:
            ends_s = np.cumsum(line_durations(moves, start_mm, self.motion))
            waits[0] = max(0.0, self.least_layer_time_s - since_first_bead_s
                           - first_bead_s(moves, ends_s))
        if self.heat is None:
            return beads, waits
        for _ in range(_ROUNDS):
            moves = with_waits(moves, start_mm, self.motion, waits, self.purge)
            chosen = self.heat.choose_waits(
                index, moves, start_mm, line_durations(moves, start_mm, self.motion))
            if chosen.total_s == 0:
                break
            beads, waits = beads_with_waits(beads, waits, chosen)
            moves = lines_of(beads)
        return beads, waits


def first_bead_s(moves: Moves, end_s: FloatArray) -> float:
    """When the first bead begins; lines end at `end_s` (n,), and the first of them is no bead."""
    return float(end_s[int(np.argmax(moves.kind == LineKind.BEAD)) - 1])
