"""Sums over a plan: how much dilution is made up for, and where it could not be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.part.named_bodies import NO_NAMED_BODIES, NamedBodies
from lmctl.plan.dilution.compensation import CompensatedLayer
from lmctl.plan.geometry.layer_geometry import LayerGeometry

#: A bead that deviates by less is not reported: a quarter of the tolerance of a mixture.
_REPORTED_FRACTION = 0.005
#: Layers that a message names, and that a job lists.
_MOST_NAMED, _MOST_LISTED = 3, 1000


@dataclass(frozen=True)
class UncompensatedPlace:
    """What of one layer could not be made up for.

    layer : from 1; share : of its path; worst : greatest deviation of a volume fraction
    at_mm : (x, y, z) where, in the part's own coordinates; material : which deviates most there
    surplus : whether there is too much of it
    """

    layer: int
    share: float
    worst: float
    at_mm: tuple[float, float, float]
    material: str
    surplus: bool


@dataclass
class DilutionStatistics:
    """Sums over the layers so far.

    materials : of the part, then the name of a substrate of another alloy
    """

    materials: tuple[str, ...]
    path_mm: float = 0.0
    compensated_mm: float = 0.0
    outside_mm: float = 0.0
    sums: FloatArray = field(default_factory=lambda: np.zeros(3))
    clipped_mm: float = 0.0
    worst: float = 0.0
    alternates: bool = False
    places: list[UncompensatedPlace] = field(default_factory=list)

    def add_layer(
        self, number: int, geometry: LayerGeometry, layer: CompensatedLayer | None
    ) -> None:
        """A layer with tracks. number : in the job, from 0; layer : None where it is as designed"""
        length = np.zeros(len(geometry.points_mm))
        length[1:] = np.linalg.norm(np.diff(geometry.points_mm, axis=0), axis=1)
        length[geometry.starts[:-1]] = 0.0
        path_mm = float(length.sum())
        self.path_mm += path_mm
        if layer is None or path_mm <= 0:
            return
        along = layer.along
        self.alternates = self.alternates or geometry.rounds is not None
        self.compensated_mm += path_mm
        self.outside_mm += float(length[along.outside].sum())
        self.sums += [float(length @ one) for one in (along.share, along.low, along.high)]
        off = np.abs(layer.deviation).max(axis=1)
        clipped_mm = float(length[off > _REPORTED_FRACTION].sum())
        if clipped_mm <= 0:
            return
        self.clipped_mm += clipped_mm
        at = int(off.argmax())
        which = int(np.abs(layer.deviation[at]).argmax())
        self.worst = max(self.worst, float(off[at]))
        x, y = geometry.points_mm[at].tolist()
        self.places.append(UncompensatedPlace(
            number + 1, clipped_mm / path_mm, float(off[at]), (x, y, geometry.z_mm),
            self.materials[which], bool(layer.deviation[at, which] > 0)))

    @property
    def mean_share(self) -> tuple[float, float, float]:
        """δ over all of the path that is compensated, and its interval."""
        share, low, high = (self.sums / max(self.compensated_mm, 1e-9)).tolist()
        return share, low, high

    def totals(self, bodies: NamedBodies = NO_NAMED_BODIES) -> dict[str, Any]:
        """What the job's totals hold of it."""
        share, low, high = self.mean_share
        worst = sorted(self.places, key=lambda place: -place.worst * place.share)[:_MOST_LISTED]
        return {
            "share": round(share, 4), "low": round(low, 4), "high": round(high, 4),
            "compensated_fraction": round(self.compensated_mm / max(self.path_mm, 1e-9), 5),
            "outside_measured_fraction": round(self.outside_mm / max(self.path_mm, 1e-9), 5),
            "clipped_fraction": round(self.clipped_mm / max(self.path_mm, 1e-9), 5),
            "clipped_worst": round(self.worst, 4),
            "clipped_layers": len(self.places),
            "clipped": [
                {"layer": place.layer, "share": round(place.share, 4),
                 "worst": round(place.worst, 4), "at_mm": [round(v, 2) for v in place.at_mm],
                 "material": place.material, "surplus": place.surplus,
                 "body": bodies.name_at(np.array(place.at_mm))} for place in worst],
        }

    def findings(self, bodies: NamedBodies = NO_NAMED_BODIES) -> Iterator[tuple[bool, str]]:
        """Messages for the plan's report: whether it is fine, and the text."""
        if self.compensated_mm <= 0:
            return
        share, low, high = self.mean_share
        interval = f" ({low:.1%} to {high:.1%})" if high > low else ", its interval not known"
        yield True, f"powder is fed so as to make up for a dilution of {share:.1%}{interval}"
        if self.alternates:
            yield True, ("every other track of the first layer comes first, and wider: there beads "
                         "melt the substrate, not each other")
        if self.outside_mm > 0.01 * self.path_mm:
            yield False, (f"{self.outside_mm / self.path_mm:.1%} of the path has an energy per "
                          "length at which dilution was not measured")
        if not self.clipped_mm:
            return
        yield False, (f"{self.clipped_mm:.0f} mm of path ({self.clipped_mm / self.path_mm:.2%}) "
                      f"cannot make up for dilution: off by up to {self.worst:.3f}")
        named = sorted(self.places, key=lambda place: -place.worst * place.share)
        for place in named[:_MOST_NAMED]:
            body = bodies.name_at(np.array(place.at_mm))
            of = "" if body is None else f" of body {body!r}"
            x, y, z = (v + 0.0 for v in np.round(place.at_mm, 1))
            yield False, (f"dilution of layer {place.layer}, {place.share:.1%} of it{of}: too "
                          f"{'much' if place.surplus else 'little'} {place.material} by "
                          f"{place.worst:.3f} at x {x:.1f}, y {y:.1f}, z {z:.1f} mm")
        if len(named) > _MOST_NAMED:
            yield False, f"and {len(named) - _MOST_NAMED} more layers with such places"
