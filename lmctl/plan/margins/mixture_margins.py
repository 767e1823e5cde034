"""How much of the path and of the volume gets its mixture: as predicted, and at worst.

At worst means within the intervals of the calibration that the profile reads. Where nothing is
measured there are no intervals, and none are made up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import STANDARD_ERRORS_OF_95_PERCENT
from lmctl.config.measuring import CalibrationUse
from lmctl.plan.margins.bead_volume import LayerVolume, WorstPlace, resolvable_per_mm
from lmctl.plan.margins.cell_parameters import (
    CellParameter,
    cell_parameters,
    cell_values,
)
from lmctl.plan.margins.path_shares import PathShares
from lmctl.plan.margins.worst_case import (
    Levels,
    ValuesOf,
    WorstCase,
    as_planned,
    worst_case,
)
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.mixture_prediction import MixturePrediction
from lmctl.plan.sequence.nozzle_flow import CellValues
from lmctl.plan.sequence.sampled_layers import SampledLayers
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION

#: Volume fraction within which a deposited volume counts as right.
VOLUME_TOLERANCE_FRACTION = 0.03
#: Prediction and run differ by so much of a fraction where a clock decides when set-points change.
_PREDICTED_WITHIN = 0.002
#: Layers of which the volume is compared.
_VOLUME_LAYERS = 4
#: Combinations are searched on about so many pieces of path; the worst is then computed on all.
_SEARCHED_PIECES = 3_000
#: Half the distance over which a gradient is taken [mm].
_NEARBY_MM = 0.25
#: Intervals so much narrower are tried as a remedy.
_TWICE_AS_WELL = 0.5
#: Cells drawn from the intervals, and the share of them that does worse than what is stated.
_DRAWS = 40
_USUAL_QUANTILE = 0.05


@dataclass(frozen=True)
class ShareRange:
    """A share that gets its mixture. worst, best : within the intervals; None without any"""

    predicted: float
    worst: float | None = None
    best: float | None = None

    def as_json(self) -> dict[str, float]:
        """Rounded, for the job's totals."""
        found = {"predicted": self.predicted, "worst": self.worst, "best": self.best}
        return {key: round(value, 4) for key, value in found.items() if value is not None}


@dataclass(frozen=True)
class BeadResolution:
    """What beads carry of the design, however well powder is timed.

    volume_share : within tolerance if every bead had its own mixture exactly
    strip_mm : nominal width of a track's strip
    limit_per_mm : steepest gradient across tracks that they carry
    worst : where they are farthest from the design, and how steep it is there
    """

    volume_share: float
    strip_mm: float
    limit_per_mm: float
    worst: WorstPlace
    gradient_per_mm: float


@dataclass(frozen=True)
class MixtureMargins:
    """What a plan says of its mixture.

    path, volume : shares within ±0.02 and ±0.03
    layers, of_layers : of how many layers the range was found, and of how many there are
    unmeasured : hoppers without intervals, by name
    case : None without intervals
    usual : share of the path that 95 of 100 cells reach whose values scatter as the intervals say
    known_better : worst share of the path if all intervals were half as wide; None without any
    """

    path: ShareRange
    volume: ShareRange
    resolution: BeadResolution
    layers: int
    of_layers: int
    unmeasured: tuple[str, ...]
    case: WorstCase | None
    usual: float | None = None
    known_better: float | None = None

    def as_json(self) -> dict[str, Any]:
        """For the job's totals."""
        found: dict[str, Any] = {
            "path": self.path.as_json(), "volume": self.volume.as_json(),
            "path_tolerance": MIXTURE_TOLERANCE_FRACTION,
            "volume_tolerance": VOLUME_TOLERANCE_FRACTION,
            "volume_resolvable": round(self.resolution.volume_share, 4),
            "layers": [self.layers, self.of_layers],
            "intervals_not_measured": list(self.unmeasured),
        }
        if self.case is not None:
            found["most_sensitive_to"] = [
                {"what": one.text, "path": round(one.share, 4)} for one in self.case.alone[:3]]
            found["at_worst"] = [
                {"what": one.text, "path_without": round(one.share, 4)}
                for one in self.case.without]
        if self.usual is not None:
            found["path_95_of_100"] = round(self.usual, 4)
        if self.known_better is not None:
            found["path_worst_if_known_twice_as_well"] = round(self.known_better, 4)
        return found


def mixture_margins(
    samples: SampledLayers, recipe: Recipe, use: CalibrationUse | None,
    composition: Callable[[FloatArray], FloatArray], predicted_share: float,
    dilution_half_width: float = 0.0,
) -> MixtureMargins | None:
    """The margins of a plan; None for a part of one material, or without beads.

    samples : of the predicted layers; predicted_share : of the whole path
    use : the calibration that the profile's values come from
    composition : the part's, at points (n, 3)
    dilution_half_width : of its interval, where the plan makes up for it
    """
    layers = samples.layers
    if len(recipe.materials) < 2 or not layers:
        return None
    intervals = {} if use is None else use.intervals
    parameters = cell_parameters(recipe.hoppers, recipe.catch_efficiency, intervals,
                                 dilution_half_width)
    planned = CellValues.believed(recipe.hoppers, recipe.catch_efficiency)
    known = [intervals.get(hopper.name) for hopper in recipe.hoppers]
    shares = PathShares(layers, recipe.density_g_mm3, MIXTURE_TOLERANCE_FRACTION,
                        mixture_catch=recipe.mixture_catch)
    unmeasured = tuple(hopper.name for hopper in recipe.hoppers if hopper.name not in intervals)
    volumes = _Volumes(layers, recipe, composition)

    def values_of(parameters: Sequence[CellParameter], levels: Levels) -> CellValues:
        values = [one.at(level) for one, level in zip(parameters, levels, strict=True)]
        return cell_values(planned, parameters, values, known)

    if not parameters:
        return MixtureMargins(
            ShareRange(predicted_share),
            ShareRange(volumes.share(*shares.laid(planned))), volumes.resolution(),
            len(layers), samples.seen, unmeasured, None)
    every = max(1, len(shares.length_mm) // _SEARCHED_PIECES)
    thinned = shares if every == 1 else PathShares(
        layers, recipe.density_g_mm3, MIXTURE_TOLERANCE_FRACTION, every, recipe.mixture_catch)
    at = partial(values_of, parameters)
    case = worst_case(thinned, parameters, at)
    narrowed = [one.narrowed(_TWICE_AS_WELL) for one in parameters]
    better = shares.share(shares.errors(values_of(narrowed, case.at_worst)))
    by_volume = [volumes.share(*shares.laid(at(levels)))
                 for levels in (as_planned(parameters), case.at_worst, case.at_best)]
    path = _path_range(shares, case, at, predicted_share)
    drawn = [thinned.share(thinned.errors(cell_values(planned, parameters, values, known)))
             for values in _drawn(parameters)]
    usual = float(np.quantile(drawn, _USUAL_QUANTILE)) + predicted_share - case.planned
    return MixtureMargins(
        path, ShareRange(by_volume[0], min(by_volume), max(by_volume)), volumes.resolution(),
        len(layers), samples.seen, unmeasured, case, min(max(usual, 0.0), predicted_share), better)


def _drawn(parameters: Sequence[CellParameter]) -> FloatArray:
    """(draws, parameters) values as likely as their intervals say; the same for every plan."""
    scale = np.array([(one.high - one.low) / 2.0 for one in parameters])
    random = np.random.default_rng(1).standard_normal((_DRAWS, len(parameters)))
    drawn = [one.planned for one in parameters] + random * (scale / STANDARD_ERRORS_OF_95_PERCENT)
    return np.asarray(np.maximum(drawn, [
        -np.inf if one.kind == "offset" else 0.0 for one in parameters]))


def _path_range(
    shares: PathShares, case: WorstCase, values_of: ValuesOf, predicted: float
) -> ShareRange:
    """The range of the whole path: the sampled layers', moved to what all layers have as planned.

    What lies as near to the tolerance as predictions are to runs is counted to its worse side.
    """
    planned = shares.share(shares.errors(values_of(as_planned(case.at_worst))))
    worst = shares.share(shares.errors(values_of(case.at_worst)), -_PREDICTED_WITHIN)
    best = shares.share(shares.errors(values_of(case.at_best)), _PREDICTED_WITHIN)
    moved = predicted - planned
    return ShareRange(predicted, min(max(worst + moved, 0.0), predicted),
                      max(min(best + moved, 1.0), predicted))


class _Volumes:
    """Shares of volume of some of the layers."""

    def __init__(
        self, layers: Sequence[MixturePrediction], recipe: Recipe,
        composition: Callable[[FloatArray], FloatArray],
    ) -> None:
        self._recipe = recipe
        self._composition = composition
        sizes = np.cumsum([0, *(len(layer.pieces) for layer in layers)])
        chosen = np.unique(np.linspace(0, len(layers) - 1, _VOLUME_LAYERS).round().astype(int))
        self._duration_s = [layers[k].pieces.duration_s for k in chosen]
        self._rows = [slice(int(sizes[k]), int(sizes[k + 1])) for k in chosen]
        self._layers = [
            LayerVolume(layers[k].pieces, recipe.pitch_mm / recipe.bead_mm,
                        recipe.layer_height_mm, composition) for k in chosen]

    def share(self, laid: FloatArray, volume_mm3_s: FloatArray) -> float:
        """Share within tolerance.

        laid, volume_mm3_s : what beads are of, and how much, of all sampled pieces of path
        """
        return self._share([
            layer.errors(laid[rows, : layer.columns]
                         * (volume_mm3_s[rows] * duration_s)[:, None])
            for layer, rows, duration_s in zip(self._layers, self._rows, self._duration_s,
                                               strict=True)])

    def resolution(self) -> BeadResolution:
        """What beads carry if each has its own mixture exactly."""
        found = [layer.errors(layer.as_designed()) for layer in self._layers]
        worst = max((layer.worst_place(errors) for layer, (errors, _) in
                     zip(self._layers, found, strict=True)), key=lambda place: place.error)
        shifts = np.vstack([[0, 0, 0], _NEARBY_MM * np.array([[1, 0, 0], [0, 1, 0]])])
        rise = [self._composition(worst.place_mm[None] + side * shifts) for side in (1.0, -1.0)]
        steepness = (rise[0][1:] - rise[1][1:]) / (2.0 * _NEARBY_MM)
        return BeadResolution(
            self._share(found), self._recipe.pitch_mm,
            resolvable_per_mm(self._recipe.bead_mm, self._recipe.pitch_mm,
                              VOLUME_TOLERANCE_FRACTION),
            worst, float(np.sqrt((steepness**2).sum(axis=0)).max()))

    @staticmethod
    def _share(found: list[tuple[FloatArray, FloatArray]]) -> float:
        right = sum(float(volume[errors <= VOLUME_TOLERANCE_FRACTION + 1e-9].sum())
                    for errors, volume in found)
        return right / max(sum(float(volume.sum()) for _, volume in found), 1e-12)
