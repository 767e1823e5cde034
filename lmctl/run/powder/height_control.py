"""Height of the part, measured between layers, and the powder that brings it back to its plan.

Every so many layers, as the job states, the run is held at the end of a layer and the operator
enters how high the part is. From its growth since the last check follows the volume that the next
layers need to stay within a tolerance of their planned height; all hoppers are scaled alike, so
that the mixture stays. Within the tolerance the planned volume is fed: beads stand beyond the
outline of a small part, which cannot have both its planned height and its planned volume.
The nozzle keeps its planned heights: a part that is about as high as planned has its standoff
(docs/decisions/031-height-by-volume-not-by-offset.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from lmctl.errors import UsageError
from lmctl.job.schema import JobManifest
from lmctl.run.journal.recorder import RunRecorder

#: Powder is scaled by no more than this, up or down.
MAX_VOLUME_CHANGE = 0.1
#: A tolerance is no greater than this share of the planned height.
MAX_TOLERANCE_SHARE = 0.025
#: A height beyond these shares of the planned one is rather in another unit, or of another part.
_PLAUSIBLE_SHARES = (0.5, 1.5)


@dataclass(frozen=True)
class LayerBoundary:
    """layers : deposited when the run is to be held; line : the first one that is not sent"""

    layers: int
    line: int


class HeightControl:
    """The height checks of one run.

    every : layers between checks
    volume_factor : on all flows, from the last check on
    awaited : layers after which the run is held for a height; None where it is not
    """

    def __init__(self, manifest: JobManifest, recorder: RunRecorder) -> None:
        self.every = int(manifest.totals["height_check_every"])
        self._tolerance_mm = float(manifest.totals.get("height_tolerance_mm", 0.0))
        self.volume_factor = 1.0
        self.awaited: int | None = None
        self._layers = manifest.layers
        self._recorder = recorder
        self._checked_layers, self._checked_mm = 0, 0.0
        first, *more = manifest.layers
        self._layer_mm = more[0].z_mm - first.z_mm if more else 0.0

    @classmethod
    def of_job(cls, manifest: JobManifest, recorder: RunRecorder) -> HeightControl | None:
        """The checks that a job asks for; None where it asks for none."""
        return cls(manifest, recorder) if manifest.totals.get("height_check_every") else None

    def go_on_from(self, records: Iterable[Mapping[str, Any]]) -> None:
        """Take up where the journal of an earlier run has left off. records : all of them"""
        last = None
        for record in records:
            if record["kind"] == "height" and record["height_mm"] is not None:
                last = record
        if last is not None:
            self.volume_factor = float(last["volume_factor"])
            self._checked_layers = int(last["layers"])
            self._checked_mm = float(last["height_mm"])
            self._record("earlier run", last["planned_mm"], last["at_limit"])

    def planned_mm(self, layers: int) -> float:
        """Planned height of the part under way after so many layers, above what it stands on."""
        begun = self._layers_before_part(layers)
        if layers == begun:
            return 0.0
        return self._layers[layers - 1].z_mm - self._layers[begun].z_mm + self._layer_mm

    def _layers_before_part(self, layers: int) -> int:
        """Layers of the job before the part whose layer was the last of so many.

        Copies of a part that are deposited one after the other begin below where the one before
        ends.
        """
        for number in range(layers - 1, 0, -1):
            if self._layers[number].z_mm < self._layers[number - 1].z_mm:
                return number
        return 0

    def _layers_to_end_of_part(self, layers: int) -> int:
        """Layers of the job when the part under way is finished."""
        for number in range(layers, len(self._layers)):
            if self._layers[number].z_mm < self._layers[number - 1].z_mm:
                return number
        return len(self._layers)

    def next_boundary(self, layer: int) -> LayerBoundary | None:
        """Where a run that enters layer `layer`, from 0, is held next; None where it is not."""
        layers = (layer // self.every + 1) * self.every
        while layers < len(self._layers):
            if self._layers_to_end_of_part(layers) > layers:  # else nothing is left to correct
                return LayerBoundary(layers, self._layers[layers].first_line)
            layers += self.every
        return None

    def on_boundary(self, boundary: LayerBoundary) -> None:
        """The run has come to a boundary, and is about to be held."""
        self.awaited = boundary.layers

    def request_text(self) -> str:
        """What the operator is asked for."""
        layers = self.awaited or 0
        return (f"height check after layer {layers}: measure the part above what it stands on "
                f"(planned: {self.planned_mm(layers):.2f} mm), then `lmctl height MM` and "
                "`lmctl resume`")

    def enter(self, height_mm: float | None) -> str:
        """A height was measured above what the part stands on; None: it was not.

        returns : a sentence for people
        Raises UsageError where none is awaited, or this one cannot be.
        """
        layers = self.awaited
        if layers is None:
            raise UsageError("no height is asked for now",
                             hint=f"the run is held for it every {self.every} layers")
        if height_mm is None:
            self.awaited = None
            self._recorder.record_height(layers=layers, height_mm=None, source="not measured",
                                         volume_factor=round(self.volume_factor, 4))
            return f"height after layer {layers} is not measured: powder stays as it is"
        planned_mm = self.planned_mm(layers)
        low, high = (share * planned_mm for share in _PLAUSIBLE_SHARES)
        if not low <= height_mm <= high:
            raise UsageError(
                f"a height of {height_mm:g} mm is not to be believed after {layers} layers",
                where=f"planned: {planned_mm:.2f} mm above what the part stands on",
                hint="is it in millimetres, from the plate to the top of the part?")
        wanted = self._factor_for(layers, height_mm)
        self.volume_factor = min(max(wanted, 1.0 - MAX_VOLUME_CHANGE), 1.0 + MAX_VOLUME_CHANGE)
        self.awaited, self._checked_layers, self._checked_mm = None, layers, height_mm
        at_limit = abs(wanted - self.volume_factor) > 1e-9
        self._record("entered", round(planned_mm, 3), at_limit)
        text = (f"height after layer {layers}: {height_mm:g} mm of {planned_mm:.2f} mm planned; "
                f"powder at {100 * self.volume_factor:.1f} % from now on")
        if at_limit:
            text += (f", and {100 * wanted:.0f} % would be needed: look at catch, powder and "
                     "standoff, or plan the rest anew")
        return text

    def _factor_for(self, layers: int, height_mm: float) -> float:
        """Scale with which the next check would find the height within its tolerance, by the growth
        so far: 1 where the planned volume does that."""
        planned_mm = self.planned_mm(layers)
        before_layers, before_mm = self._checked_layers, self._checked_mm
        if before_layers <= self._layers_before_part(layers):  # the first check of this part
            before_layers, before_mm = self._layers_before_part(layers), 0.0
        before_planned_mm = self.planned_mm(before_layers) if before_mm else 0.0
        growth = (height_mm - before_mm) / (planned_mm - before_planned_mm)
        per_volume = max(growth / self.volume_factor, 1e-3)
        until = min(layers + self.every, self._layers_to_end_of_part(layers))
        next_mm = self.planned_mm(until)
        tolerance_mm = min(self._tolerance_mm, MAX_TOLERANCE_SHARE * next_mm)
        least, most = ((edge_mm - height_mm) / (per_volume * (next_mm - planned_mm))
                       for edge_mm in (next_mm - tolerance_mm, next_mm + tolerance_mm))
        return min(max(1.0, least), most)

    def _record(self, source: str, planned_mm: float, at_limit: bool) -> None:
        self._recorder.record_height(
            layers=self._checked_layers, height_mm=round(self._checked_mm, 3),
            planned_mm=planned_mm, volume_factor=round(self.volume_factor, 4), at_limit=at_limit,
            source=source)
