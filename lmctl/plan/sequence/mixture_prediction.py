"""Predict the deposited mixture along the beads, with what running does to set-points.

Set-points of the last seconds of a layer depend on the next: a layer is predicted as soon as they
are known.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from lmctl.array_types import FloatArray
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.bead_pieces import BeadPieces
from lmctl.plan.sequence.held_setpoints import HeldSetpoints, SetpointChanges
from lmctl.plan.sequence.nozzle_flow import CellValues, nozzle_flow_g_s
from lmctl.plan.sequence.powder_flow import PowderFlow


@dataclass(frozen=True)
class MixturePrediction:
    """One layer's prediction, with the profile's values of hoppers.

    pieces : q pieces of its beads
    predicted : (q, materials) volume fractions as beads are predicted to be, with what they melt
    changes : of set-points, from so long before that those earlier no longer matter
    """

    pieces: BeadPieces
    predicted: FloatArray
    changes: SetpointChanges


class PathPredictor:
    """Predicts the layers of a job in order. leads : powder mode "lead" """

    def __init__(self, recipe: Recipe, *, leads: bool) -> None:
        self._recipe = recipe
        self._setpoints = HeldSetpoints(recipe.hoppers, leads=leads)
        self._values = CellValues.believed(recipe.hoppers, recipe.catch_efficiency)
        self._kept_s = 2.0 * self._values.settling_s()
        self._waiting: deque[BeadPieces] = deque()

    def add_layer(self, pieces: BeadPieces | None, flow: PowderFlow) -> list[MixturePrediction]:
        """The next layer of the program; what can be predicted now.

        pieces : None for a layer without beads
        flow : going on from the layer before
        """
        if pieces is not None and len(pieces):
            self._waiting.append(pieces)
        self._setpoints.add_flow(flow.times_s, flow.g_s)
        return list(self._predicted())

    def finish(self) -> list[MixturePrediction]:
        """The program ends; predictions of the layers that are left."""
        self._setpoints.finish()
        return list(self._predicted())

    def _predicted(self) -> Iterator[MixturePrediction]:
        known_s = self._setpoints.known_until_s
        while self._waiting and self._waiting[0].at_s[-1] <= known_s:
            pieces = self._waiting.popleft()
            begin_s = float(pieces.at_s[0]) - self._kept_s
            self._setpoints.forget_before(begin_s)
            changes = self._setpoints.changes_since(begin_s)
            changes = changes.until(float(pieces.at_s[-1]))
            flow = nozzle_flow_g_s(changes, self._values, pieces.at_s)
            fed = self._recipe.deposited_fractions(flow)
            yield MixturePrediction(pieces, pieces.laid(fed), changes)
