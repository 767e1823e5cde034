"""The alloy rules of a part: what part file and shared files state, as regions of its mixtures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.config.alloy_rules import AlloyRuleSettings
from lmctl.part.materials.forbidden_regions import ForbiddenRegions
from lmctl.part.sources.alloy_maps import AlloyMap

#: With more named mixtures than these, blends are those between one and the next only.
_MOST_NAMED = 40
#: One convex piece: inequalities rows (q, m) @ x ≥ bounds (q,).
_Piece = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class AlloyRule:
    """One rule, as far as it concerns a part.

    way : "jump", "around" or "auto"; margin : distance in each volume fraction
    through : (m,) bool, the part's materials that a way round may use
    """

    name: str
    way: str
    margin: float
    reason: str
    source: str
    through: tuple[bool, ...]

    def as_text(self) -> str:
        """The rule with its reason, for people."""
        return f"{self.name}: {self.reason}" + (f" ({self.source})" if self.source else "")


@dataclass(frozen=True, eq=False)
class AlloyRules:
    """All rules of a part over its materials.

    named : (k, m) float64, the mixtures that the part file names, each once, in its order
    """

    materials: tuple[str, ...]
    rules: tuple[AlloyRule, ...]
    regions: ForbiddenRegions
    named: FloatArray

    @cached_property
    def margins(self) -> FloatArray:
        """Of each rule, (r,) float64."""
        return np.array([rule.margin for rule in self.rules], dtype=np.float64)

    def blends(self) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Pairs of named mixtures that the part may blend, the most different ones first."""
        named = self.named
        if len(named) <= _MOST_NAMED:
            i, j = np.triu_indices(len(named), 1)
        else:
            i, j = np.arange(len(named) - 1), np.arange(1, len(named))
        order = np.argsort(-np.linalg.norm(named[i] - named[j], axis=1), kind="stable")
        yield from zip(named[i[order]], named[j[order]], strict=True)

    def mixture_text(self, fractions: FloatArray) -> str:
        """A mixture for people, such as "60 % 316L + 40 % WC-12Co"."""
        return " + ".join(f"{100 * share:.3g} % {name}" for name, share in
                          zip(self.materials, fractions, strict=True) if share > 1e-6)


def alloy_rules_of(
    settings: Sequence[tuple[AlloyRuleSettings, AlloyMap | None]], materials: tuple[str, ...],
    named: FloatArray,
) -> AlloyRules | None:
    """The rules that concern a part; None where none of them does.

    settings : each with its map, if it names one
    A powder that the part does not have is 0 in all its mixtures.
    """
    rules: list[AlloyRule] = []
    pieces: list[_Piece] = []
    owner: list[int] = []
    for rule, cells in settings:
        found = [_restricted(piece, rule.powders, materials) for piece in _pieces(rule, cells)]
        own = [piece for piece in found if piece is not None]
        if not own:
            continue
        pieces += own
        owner += [len(rules)] * len(own)
        through = materials if rule.through is None else (*rule.through, *rule.powders)
        rules.append(AlloyRule(rule.name, rule.way, rule.margin, rule.reason, rule.source,
                               tuple(name in through for name in materials)))
    if not rules:
        return None
    regions = ForbiddenRegions(
        np.ascontiguousarray(np.concatenate([rows for rows, _ in pieces])),
        np.concatenate([bounds for _, bounds in pieces]),
        np.concatenate([[0], np.cumsum([len(bounds) for _, bounds in pieces])]).astype(np.intp),
        np.array(owner, dtype=np.intp))
    return AlloyRules(materials, tuple(rules), regions, named)


def _pieces(rule: AlloyRuleSettings, cells: AlloyMap | None) -> Iterator[_Piece]:
    """Convex pieces over the rule's own powders, in its order."""
    names, m = rule.powders, len(rule.powders)
    for region in rule.forbidden:
        rows, bounds = [], []
        for name, (low, high) in region.items():
            axis = np.eye(m)[names.index(name)]
            rows += [axis, -axis]
            bounds += [low, -high]
        yield np.array(rows), np.array(bounds)
    if rule.inequalities:
        yield (np.array([[item.of.get(name, 0.0) for name in names]
                         for item in rule.inequalities]),
               np.array([item.at_least for item in rule.inequalities]))
    if rule.polygon:
        corners = np.array([[corner.get(name, 0.0) for name in names] for corner in rule.polygon])
        for triangle in _triangles(corners):
            yield _relative(*_half_planes(triangle), rule.others_below)
    if cells is not None:
        pairs = np.array([np.eye(m)[i] - np.eye(m)[j]
                          for i in range(m) for j in range(m) if i != j])
        order = [cells.powders.index(name) for name in names]
        for middle in cells.forbidden[:, order]:
            yield _relative(pairs, pairs @ middle - cells.resolution, rule.others_below)


def _relative(rows: FloatArray, bounds: FloatArray, others_below: float) -> _Piece:
    """A piece of mixtures of the rule's powders alone, for mixtures with others beside them:
    the rule's powders in proportion, and together at least 1 − others_below."""
    cone = rows - bounds[:, None]
    together = np.ones((1, rows.shape[1]))
    return np.concatenate([cone, together]), np.append(np.zeros(len(rows)), 1 - others_below)


def _restricted(piece: _Piece, powders: tuple[str, ...], materials: tuple[str, ...]
                ) -> _Piece | None:
    """A piece over the part's materials; None where no mixture of them lies in it.

    Each fraction's own range is asked, and each inequality's largest value: enough to leave out
    what plainly does not concern the part.
    """
    rows, bounds = piece
    wide = np.zeros((len(rows), len(materials)))
    for column, name in enumerate(powders):
        if name in materials:
            wide[:, materials.index(name)] = rows[:, column]
    return None if (wide.max(axis=1) < bounds - 1e-12).any() else (wide, bounds)


def _triangles(corners: FloatArray) -> list[FloatArray]:
    """A polygon of mixtures (k, 3) in triangles (3, 3); none where it has no area."""
    from manifold3d import CrossSection, FillRule, triangulate  # late: few rules have one

    flat = CrossSection([corners[:, :2]], FillRule.NonZero)
    if flat.area() <= 1e-12:
        flat = CrossSection([corners[::-1, :2]], FillRule.NonZero)
    loops = flat.to_polygons()
    if not loops:
        return []
    points = np.concatenate(loops)
    index: IndexArray = np.asarray(triangulate(loops), dtype=np.intp)
    full = np.column_stack([points, 1 - points.sum(axis=1)])
    return [full[three] for three in index]


def _half_planes(triangle: FloatArray) -> _Piece:
    """Inequalities of a triangle of mixtures (3, 3) of three powders."""
    rows, bounds = [], []
    for k in range(3):
        a, b, inner = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
        row = np.cross(b - a, np.ones(3))
        size = float(np.linalg.norm(row))
        if size <= 1e-12:
            continue
        row = row / size * np.sign(row @ (inner - a) or 1.0)
        rows.append(row)
        bounds.append(float(row @ a))
    return np.array(rows), np.array(bounds)
