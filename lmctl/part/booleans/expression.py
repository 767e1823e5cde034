"""Any boolean of booleans as one function of its distinct leaves.

Source: docs/explanation/multi-colour-distance-field.md, Booleans.

A union is the greatest of its bodies' distances, an intersection the least, and inside out is the
negative; so a whole tree is a formula of least and greatest over the distances of its leaves. The
same formula over signs −1, 0, 1 is three-valued logic: 0, where a side is not known, comes through
only where it matters. A leaf that several bodies name is one leaf, so what is equal as a set of
places is equal as a function of the leaves.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.part.bodies.allowance import AllowanceBody
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.measured import Bounds

#: What is known of each leaf, one row each: distances, or sides (int8).
Rows = Sequence[NDArray[Any]] | NDArray[Any]
Operation = Literal["union", "difference", "intersection"]


@dataclass(frozen=True)
class SignedLeaf:
    """A leaf (by number) as it is, or inside out (sign −1)."""

    leaf: int
    sign: int


@dataclass(frozen=True)
class BooleanFormula:
    """What is in all of several formulas, or in any of them."""

    requires_all: bool
    operands: tuple[Formula, ...]


Formula = SignedLeaf | BooleanFormula


@dataclass(frozen=True, eq=False)
class BooleanExpression:
    """A set of places by its leaves: bodies that are not booleans themselves."""

    leaves: tuple[Body, ...]
    formula: Formula

    def evaluate(self, rows: Rows) -> NDArray[Any]:
        """The formula over what is known of each leaf."""
        return _evaluated(self.formula, rows)

    @property
    def enclosing_box_mm(self) -> Bounds:
        """A box that holds it; may be infinite."""
        boxes = [leaf.enclosing_box_mm for leaf in self.leaves]
        return _boxed(self.formula, boxes)

    def signed_leaves(self) -> list[tuple[int, int]]:
        """(leaf, sign) of every side that the formula uses, each once."""
        return list(dict.fromkeys((side.leaf, side.sign) for side in _sides(self.formula)))

    def outward_allowance_mm(self) -> float:
        """How far outlines may lie outside those of the drawing, by allowances of leaves; ≥ 0."""
        moved = [sign * body.allowance_mm for leaf, sign in self.signed_leaves()
                 if isinstance(body := self.leaves[leaf], AllowanceBody)]
        return max([0.0, *moved])


def expression_of(body: Body) -> BooleanExpression:
    """A body by its leaves: a boolean's own, or the body itself as the only one."""
    found = getattr(body, "expression", None)
    return found if isinstance(found, BooleanExpression) else BooleanExpression((body,),
                                                                                SignedLeaf(0, 1))


def combine(operation: Operation, parts: Sequence[BooleanExpression]) -> BooleanExpression:
    """Several as one; a difference takes all others from the first."""
    numbers: dict[Hashable, int] = {}
    leaves: list[Body] = []
    formulas = []
    for part in parts:
        places = []
        for leaf in part.leaves:
            key = leaf.identity_key
            if key not in numbers:
                numbers[key] = len(leaves)
                leaves.append(leaf)
            places.append(numbers[key])
        formulas.append(_renumbered(part.formula, places))
    if operation == "difference":
        formulas[1:] = [_inside_out(formula) for formula in formulas[1:]]
    every = operation != "union"
    flat: list[Formula] = []
    for formula in formulas:
        inner = isinstance(formula, BooleanFormula) and formula.requires_all == every
        flat += formula.operands if isinstance(formula, BooleanFormula) and inner else [formula]
    return BooleanExpression(tuple(leaves), BooleanFormula(every, tuple(dict.fromkeys(flat))))


def _evaluated(formula: Formula, rows: Rows) -> NDArray[Any]:
    if isinstance(formula, SignedLeaf):
        row: NDArray[Any] = rows[formula.leaf]
        return row if formula.sign > 0 else -row
    found = [_evaluated(part, rows) for part in formula.operands]
    return reduce(np.minimum if formula.requires_all else np.maximum, found)


def _renumbered(formula: Formula, places: Sequence[int]) -> Formula:
    if isinstance(formula, SignedLeaf):
        return SignedLeaf(places[formula.leaf], formula.sign)
    return BooleanFormula(formula.requires_all,
                          tuple(_renumbered(part, places) for part in formula.operands))


def _inside_out(formula: Formula) -> Formula:
    """De Morgan's law, down to the leaves."""
    if isinstance(formula, SignedLeaf):
        return SignedLeaf(formula.leaf, -formula.sign)
    return BooleanFormula(not formula.requires_all,
                          tuple(_inside_out(part) for part in formula.operands))


def _boxed(formula: Formula, boxes: Sequence[Bounds]) -> Bounds:
    if isinstance(formula, SignedLeaf):
        if formula.sign > 0:
            return boxes[formula.leaf]
        return np.full(3, -np.inf), np.full(3, np.inf)
    lows, highs = zip(*(_boxed(part, boxes) for part in formula.operands), strict=True)
    if formula.requires_all:
        return np.max(lows, axis=0), np.min(highs, axis=0)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _sides(formula: Formula) -> list[SignedLeaf]:
    if isinstance(formula, SignedLeaf):
        return [formula]
    return [side for part in formula.operands for side in _sides(part)]
