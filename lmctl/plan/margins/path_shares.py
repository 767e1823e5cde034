"""The share of path that gets its mixture, on a cell that is not quite what is planned with.

Flow at the nozzle is linear in slope and offset, and volume in the catch efficiency; only dead time
and lags need the way through the hose computed anew, and each way is computed once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.dilution import MAX_DILUTION
from lmctl.plan.mixture_catch import MixtureCatch
from lmctl.plan.sequence.mixture_prediction import MixturePrediction
from lmctl.plan.sequence.nozzle_flow import CellValues, hopper_outflow

_ROUNDING = 1e-9


class PathShares:
    """Shares of the path of some layers.

    density_g_mm3 : (hoppers,) of the powders; mixture_catch : by which they change each other's
        catch; None where they do not; every : only each so many-th piece is looked at
    length_mm : (q,) of all pieces of path; designed : (q, materials) as the part file has them, and
        a last column for a foreign substrate where dilution is compensated
    """

    def __init__(
        self, layers: Sequence[MixturePrediction], density_g_mm3: FloatArray, tolerance: float,
        every: int = 1, mixture_catch: MixtureCatch | None = None,
    ) -> None:
        self._mixture_catch = mixture_catch
        self._changes = [layer.changes for layer in layers]
        self._at_s = [layer.pieces.at_s[::every] for layer in layers]
        self._density_g_mm3 = density_g_mm3
        self._tolerance = tolerance
        self.length_mm = np.concatenate([layer.pieces.length_mm[::every] for layer in layers])
        self._materials = layers[0].pieces.fed.shape[1]
        with_below = any(layer.pieces.melted is not None for layer in layers)
        columns = self._materials + int(with_below)
        self.designed = np.concatenate([
            _padded(layer.pieces.designed[::every], columns) for layer in layers])
        self._melted_share, self._below = np.zeros(0), np.zeros((0, columns))
        if with_below:
            melted = [layer.pieces.melted for layer in layers]
            count = [len(at_s) for at_s in self._at_s]
            self._melted_share = np.concatenate([
                np.zeros(n) if one is None else one.share[::every]
                for one, n in zip(melted, count, strict=True)])
            self._below = np.concatenate([
                np.zeros((n, columns)) if one is None else one.below[::every]
                for one, n in zip(melted, count, strict=True)])
        self._total_mm = float(self.length_mm.sum())
        self._ways: dict[tuple[float, ...], tuple[FloatArray, FloatArray]] = {}

    def volume_mm3_s(self, values: CellValues) -> FloatArray:
        """Volume of each powder that stays on the part, (q, materials) [mm³/s]."""
        volume = np.empty((len(self.length_mm), self._materials))
        for hopper in range(self._materials):
            setpoint, turning = self._way(values, hopper)
            flow_g_min = values.slope[hopper] * setpoint + values.offset_g_min[hopper] * turning
            volume[:, hopper] = np.maximum(flow_g_min, 0.0)
        if self._mixture_catch is not None:
            volume *= self._mixture_catch.efficiency(volume) / self._mixture_catch.alone
        volume *= values.catch_efficiency / self._density_g_mm3 / 60.0
        return volume

    def laid(self, values: CellValues) -> tuple[FloatArray, FloatArray]:
        """What beads are of, (q, columns of `designed`) volume fractions, and the volume of powder
        in them, (q,) [mm³/s].

        A dilution that is off makes the layer below differ, too; of that δ² arrives, and it is left
        out.
        """
        volume = self.volume_mm3_s(values)
        total = volume.sum(axis=1)
        volume /= np.maximum(total, 1e-12)[:, None]
        if not len(self._melted_share):
            return volume, total
        share = np.where(self._melted_share > 0.0, np.clip(
            self._melted_share + values.dilution_off, 0.0, MAX_DILUTION), 0.0)
        fed = _padded(volume, self.designed.shape[1])
        return fed + share[:, None] * (self._below - fed), total

    def errors(self, values: CellValues) -> FloatArray:
        """How far the mixture is off along the path, (q,) greatest difference of a fraction."""
        off = self.laid(values)[0] - self.designed
        return np.asarray(np.abs(off, out=off).max(axis=1))

    def share(self, errors: FloatArray, slack: float = 0.0) -> float:
        """Share of the path whose error is within the tolerance, less or more by a slack."""
        within = errors <= self._tolerance + slack + _ROUNDING
        return float(self.length_mm[within].sum()) / self._total_mm

    def _way(self, values: CellValues, hopper: int) -> tuple[FloatArray, FloatArray]:
        """What comes through a hopper's hose of its set-points [g/min], and of 1 for as long as
        its disc turns, (q,) each."""
        key = (hopper, float(values.dead_time_s[hopper]), float(values.lag_s[hopper]),
               float(values.drive_lag_s[hopper]))
        if key not in self._ways:
            setpoint, turning = [], []
            for changes, at_s in zip(self._changes, self._at_s, strict=True):
                sent = changes.setpoint_g_min[:, hopper]
                turns = (sent > 0.0).astype(np.float64)
                setpoint.append(hopper_outflow(changes.time_s, sent, values, hopper, at_s))
                turning.append(np.ones(len(at_s)) if turns.all() else hopper_outflow(
                    changes.time_s, turns, values, hopper, at_s))
            self._ways[key] = np.concatenate(setpoint), np.concatenate(turning)
        return self._ways[key]


def _padded(fractions: FloatArray, columns: int) -> FloatArray:
    """With columns of zeros, for materials that are not in them."""
    missing = columns - fractions.shape[1]
    return fractions if missing == 0 else np.column_stack([
        fractions, np.zeros((len(fractions), missing))])
