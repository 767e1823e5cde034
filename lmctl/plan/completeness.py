"""Check that the plan builds the part: sum up what is deposited, lost, overbuilt or unsupported.

Volumes are layer heights times the areas that each `LayerGeometry` gives. Every layer of the part
counts, also those that have no tracks and are left out of the job.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.part.named_bodies import NO_NAMED_BODIES, NamedBodies
from lmctl.plan.geometry import IslandFigures, LayerGeometry, LostFeature, OverhangPlace
from lmctl.plan.layer_matching import PiecesBelow
from lmctl.plan.part_pieces import BuiltFeature, LostPiece, Overhang

#: Lost features and overhangs that a message names; the others are counted.
_MOST_NAMED = 5
#: Lost features and overhangs that a job lists; the others are counted.
_MOST_LISTED = 1000
#: Lost pieces that are kept while planning; the others are only counted, anew in every layer (a
#: part may consist of a million crumbs).
_MOST_KEPT = 20_000


@dataclass
class Completeness:
    """Sums over all layers of a part, in order; read at the end.

    layer_height_mm : as fitted; height_left_mm : how much taller the part is than its layers,
        negative where they end above it
    named_bodies : lost pieces are named by these
    """

    process: ProcessSettings
    layer_height_mm: float
    height_left_mm: float = 0.0
    named_bodies: NamedBodies = NO_NAMED_BODIES
    slice_mm2: float = 0.0
    inside_mm2: float = 0.0
    double_mm2: float = 0.0
    outside_mm2: float = 0.0
    narrow_mm2: float = 0.0
    top_mm2: float = 0.0
    lost: list[LostPiece] = field(default_factory=list)
    lost_count: int = 0
    overhangs: list[Overhang] = field(default_factory=list)
    features: list[BuiltFeature] = field(default_factory=list)

    def __post_init__(self) -> None:
        bead = self.process.bead_width_mm
        self._features_below = PiecesBelow[BuiltFeature](bead)
        self._lost_below = PiecesBelow[LostPiece](bead)
        self._overhangs_below = PiecesBelow[Overhang](bead)

    def add_layer(self, geometry: LayerGeometry) -> None:
        """The next layer of the part, with tracks or without."""
        figures = geometry.figures
        self.slice_mm2 += figures.slice_mm2
        self.inside_mm2 += figures.inside_mm2
        self.double_mm2 += figures.double_mm2
        self.outside_mm2 += figures.outside_mm2
        self.narrow_mm2 += figures.narrow_mm2
        self.top_mm2 = figures.slice_mm2
        for island in figures.islands:
            self._add_island(geometry, island)
        for feature in figures.lost:
            self._add_lost(geometry, feature)
        for place in figures.overhang:
            self._add_overhang(geometry, place)

    @property
    def built_fraction(self) -> float:
        """Volume deposited inside the intended surface over its volume, 0 to 1."""
        height = self.layer_height_mm
        planned_mm3 = self.slice_mm2 * height + max(self.height_left_mm, 0.0) * self.top_mm2
        return self.inside_mm2 * height / planned_mm3 if planned_mm3 > 0 else 0.0

    @property
    def surplus_fraction(self) -> float:
        """Volume deposited outside the intended surface, over its volume."""
        height = self.layer_height_mm
        above = max(-self.height_left_mm, 0.0) * self.top_mm2
        planned_mm3 = self.slice_mm2 * height
        return (self.outside_mm2 * height + above) / planned_mm3 if planned_mm3 > 0 else 0.0

    def steep_overhangs(self) -> list[Overhang]:
        """Overhangs beyond the limit, and what starts in the air."""
        return [o for o in self.overhangs
                if o.is_in_air or o.angle_deg > self.process.max_overhang_deg]

    def is_complete(self) -> bool:
        """Whether nothing is lost, and enough is built."""
        return not self.lost_count and self.built_fraction >= self.process.min_built_fraction

    def totals(self) -> dict[str, Any]:
        """What the job's totals hold of it."""
        planned_mm3 = self.slice_mm2 or 1.0
        return {
            "built_fraction": round(self.built_fraction, 5),
            "surplus_fraction": round(self.surplus_fraction, 5),
            "double_fraction": round(self.double_mm2 / planned_mm3, 5),
            "narrow_fraction": round(self.narrow_mm2 / planned_mm3, 5),
            "intended_volume_mm3": round(self.slice_mm2 * self.layer_height_mm, 3),
            "layer_height_mm": round(self.layer_height_mm, 6),
            "complete": self.is_complete(),
            "feature_count": len(self.features),
            "features": [f.as_dict() for f in self._least_built()[:_MOST_LISTED]],
            "lost_count": self.lost_count,
            "lost": [piece.as_dict() for piece in self._largest_lost()],
            "overhang_count": len(self.overhangs),
            "overhangs": [o.as_dict() for o in self._worst_overhangs()[:_MOST_LISTED]],
        }

    def check(self, *, allow_incomplete: bool = False, allow_overhang: bool = False) -> None:
        """Refuse a plan that is not the part. Raises PlanError, with places and remedies."""
        if not allow_incomplete:
            self._check_lost()
            self._check_narrow()
        if not allow_overhang:
            self._check_overhang()

    def findings(self) -> Iterator[tuple[bool, str]]:
        """Messages for the plan's report: whether it is fine, and the text."""
        fine = self.built_fraction >= self.process.min_built_fraction
        yield fine, (f"{self.built_fraction:.2%} of the part's volume is deposited inside its "
                     f"surface, {self.surplus_fraction:.2%} beside it")
        if self.process.layer_height_mm != self.layer_height_mm:
            yield True, (f"layers are {self.layer_height_mm:.4g} mm high instead of "
                         f"{self.process.layer_height_mm:g}, so that whole layers fill the height")
        elif abs(self.height_left_mm) > 1e-6 * self.layer_height_mm:
            less = "less" if self.height_left_mm > 0 else "more"
            yield False, (f"whole layers of {self.layer_height_mm:g} mm come to "
                          f"{abs(self.height_left_mm):.3g} mm {less} than the part is tall")
        if self.narrow_mm2:
            yield True, (f"{self.narrow_mm2 / self.slice_mm2:.2%} of the slices are narrower than "
                         "a bead and get one track (process.narrow_features)")
        yield from ((False, f"lost: {piece.location_text()}; {piece.feature.remedy}")
                    for piece in self._largest_lost()[:_MOST_NAMED])
        yield from _more(self.lost_count, "more pieces are lost")
        if not self.overhangs:
            yield True, "no wall leans out by more than 30°"
        yield from ((False, f"overhang {o.location_text()}")
                    for o in self._worst_overhangs()[:_MOST_NAMED])
        yield from _more(len(self.overhangs), "more overhangs")

    def _check_lost(self) -> None:
        if self.is_complete():
            return
        what = (f"the plan is not the whole part: {self.built_fraction:.2%} of its volume is "
                f"deposited inside its surface")
        if self.lost_count:
            what += f", {self.lost_count} pieces are lost" if self.lost_count > 1 else (
                ", a piece is lost")
        remedies = list(dict.fromkeys(piece.feature.remedy for piece in self._largest_lost()))
        raise PlanError(
            what,
            where=[*(piece.location_text() for piece in self._largest_lost()[:_MOST_NAMED]),
                   *(text for _, text in _more(self.lost_count, "more")),
                   f"process.min_built_fraction = {self.process.min_built_fraction:g}"],
            hint="; ".join([*remedies[:2], "or plan it all the same with --allow-incomplete"]))

    def _check_narrow(self) -> None:
        if self.process.narrow_features == "refuse" and self.narrow_mm2 > 0:
            raise PlanError(
                f"{self.narrow_mm2 * self.layer_height_mm:.3g} mm³ of the part are narrower than "
                f"a bead of {self.process.bead_width_mm:g} mm",
                where='process.narrow_features = "refuse"',
                hint='lower process.bead_width_mm, or set narrow_features = "deposit" for one '
                     "track there")

    def _check_overhang(self) -> None:
        steep = [o for o in self._worst_overhangs() if o in self.steep_overhangs()]
        if not steep:
            return
        in_air = [o for o in steep if o.is_in_air]
        limit = self.process.max_overhang_deg
        what = (f"material would start in the air in {_places(len(in_air))}" if in_air else
                f"walls lean out by more than {limit:g}° in {_places(len(steep))}")
        raise PlanError(
            what,
            where=[*(o.location_text() for o in steep[:_MOST_NAMED]),
                   *(text for _, text in _more(len(steep), "more")),
                   f"process.max_overhang_deg = {limit:g}"],
            hint='turn the part (--up of a bare mesh, a body of kind "moved" in a part file), '
                 "raise process.max_overhang_deg where the process holds it, or plan it all the "
                 "same with --allow-overhang")

    def _least_built(self) -> list[BuiltFeature]:
        return sorted(self.features, key=lambda f: f.built_fraction)

    def _largest_lost(self) -> list[LostPiece]:
        """Those that are listed, with the body of each."""
        largest = sorted(self.lost, key=lambda piece: -piece.volume_mm3)[:_MOST_LISTED]
        for piece in largest:
            piece.body_name = self.named_bodies.name_at(np.array(piece.middle_mm))
        return largest

    def _worst_overhangs(self) -> list[Overhang]:
        return sorted(self.overhangs, key=lambda o: (not o.is_in_air, -o.angle_deg, -o.area_mm2))

    def _add_island(self, geometry: LayerGeometry, island: IslandFigures) -> None:
        below = self._features_below.take_piece_below("", island.at_mm, geometry.layer)
        low, high = self._span_mm(geometry)
        if below is None:
            below = BuiltFeature(island.at_mm, geometry.layer, geometry.layer, low, high)
            self.features.append(below)
        below.last_layer, below.highest_z_mm = geometry.layer, high
        below.volume_mm3 += island.slice_mm2 * self.layer_height_mm
        below.inside_mm3 += island.inside_mm2 * self.layer_height_mm
        self._features_below.remember_piece("", island.at_mm, geometry.layer, below)

    def _add_lost(self, geometry: LayerGeometry, feature: LostFeature) -> None:
        below = self._lost_below.take_piece_below(feature.kind, feature.at_mm, geometry.layer)
        low, high = self._span_mm(geometry)
        if below is None:
            self.lost_count += 1
            if len(self.lost) >= _MOST_KEPT:
                return
            below = LostPiece(feature, geometry.layer, geometry.layer, low, high, 0.0)
            self.lost.append(below)
        below.last_layer, below.highest_z_mm = geometry.layer, high
        below.volume_mm3 += feature.area_mm2 * self.layer_height_mm
        self._lost_below.remember_piece(feature.kind, feature.at_mm, geometry.layer, below)

    def _add_overhang(self, geometry: LayerGeometry, place: OverhangPlace) -> None:
        below = None if place.is_in_air else self._overhangs_below.take_piece_below(
            "", place.middle_mm, geometry.layer)
        low, high = self._span_mm(geometry)
        if below is None:
            below = Overhang(place.at_mm, geometry.layer, geometry.layer, low, high, 0.0, 0.0,
                             place.is_in_air)
            self.overhangs.append(below)
        below.last_layer, below.highest_z_mm = geometry.layer, high
        below.area_mm2 += place.area_mm2
        if place.angle_deg > below.angle_deg:
            below.at_mm, below.angle_deg = place.at_mm, place.angle_deg
        self._overhangs_below.remember_piece("", place.middle_mm, geometry.layer, below)

    def _span_mm(self, geometry: LayerGeometry) -> tuple[float, float]:
        """From where to where a layer reaches."""
        half = self.layer_height_mm / 2
        return geometry.z_mm - half, geometry.z_mm + half


def _more(count: int, what: str) -> Iterator[tuple[bool, str]]:
    if count > _MOST_NAMED:
        yield False, f"and {count - _MOST_NAMED} {what}"


def _places(count: int) -> str:
    return "one place" if count == 1 else f"{count} places"
