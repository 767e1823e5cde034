"""Alloy rules of a part file, its shared rule files and maps, with the mixtures that it names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.alloy_rules import MAX_POWDERS
from lmctl.config.composition import Composition, Profile
from lmctl.config.part_file import PartFile
from lmctl.errors import InputError
from lmctl.part.part_data import PartData

if TYPE_CHECKING:
    from lmctl.part.materials.alloy_rules import AlloyRules


def part_alloy_rules(part: PartFile, data: PartData) -> AlloyRules | None:
    """The alloy rules of a part; None where none concerns its materials.

    Raises ConfigError or InputError where a shared file or a map is wrong.
    """
    settings = list(part.alloy_rule)
    for name in part.alloy_rule_files:
        settings += data.shared_alloy_rules(name)
    if not settings:
        return None
    from lmctl.part.materials.alloy_rules import alloy_rules_of  # late: it compiles kernels

    materials = tuple(material.name for material in part.material)
    found = alloy_rules_of([(rule, data.alloy_map(rule)) for rule in settings], materials,
                           _named_mixtures(part, materials))
    if found is not None and len(materials) > MAX_POWDERS:
        raise InputError(
            f"alloy rules are kept in parts of up to {MAX_POWDERS} materials",
            where=f"{part.name} has {len(materials)}; {found.rules[0].name!r} concerns it",
            hint="plan without the rule file, or leave materials out")
    if found is not None and part.optimise is not None:
        data.warnings.append("alloy rules are kept by planning, not by `lmctl optimise`: state "
                             "mixtures that a design is to avoid in [[optimise.forbidden]]")
    left_out = [rule.name for rule in settings
                if found is None or rule.name not in {kept.name for kept in found.rules}]
    data.notes += [f"alloy rule {name!r} concerns no mixture of this part" for name in left_out]
    return found


def _named_mixtures(part: PartFile, materials: tuple[str, ...]) -> FloatArray:
    """Every mixture that compositions of the part name, and its pure materials where they name
    none, (k, m), each once."""
    named: list[FloatArray] = []
    for holder in (part, *part.body):
        if holder.composition is not None:
            for profile in _profiles(holder.composition):
                named += _without_inner_points(
                    [np.array([mixture.get(name, 0.0) for name in materials])
                     for mixture in _mixtures(profile)])
    rows = np.array(named) if named else np.eye(len(materials))
    _, first = np.unique(rows.round(9), axis=0, return_index=True)
    return np.asarray(rows[np.sort(first)])


def _without_inner_points(mixtures: list[FloatArray]) -> list[FloatArray]:
    """Mixtures in a row without those on the straight line between their neighbours."""
    kept = mixtures[:1]
    for number in range(1, len(mixtures) - 1):
        to, on = mixtures[number] - kept[-1], mixtures[number + 1] - mixtures[number]
        size = float(np.linalg.norm(to) * np.linalg.norm(on))
        if to @ on < size * (1 - 1e-9):
            kept.append(mixtures[number])
    return [*kept, *mixtures[1:][-1:]]


def _profiles(composition: Composition) -> Iterator[Profile]:
    if composition.profile is not None:
        yield composition.profile
    yield from (part.profile for part in composition.blend)


def _mixtures(profile: Profile) -> Iterator[dict[str, float]]:
    match profile.kind:
        case "table":
            yield from (point.of for point in profile.points)
        case "steps":
            yield from (step.of for step in profile.steps)
        case "constant":
            yield profile.of
        case _:
            yield from (profile.near, profile.far)
